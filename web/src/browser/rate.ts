// How often something happens, of late.

/** Over how long that is told, ms. */
const OVER_MS = 2000;

export class Rate {
  private times: number[] = [];

  /** It has happened; times are of one clock, ms. */
  note(now: number): void {
    this.times = [...this.recent(now), now];
  }

  /** How many times a second. */
  at(now: number): number {
    return this.recent(now).length / (OVER_MS / 1000);
  }

  forget(): void {
    this.times = [];
  }

  private recent(now: number): number[] {
    return this.times.filter((time) => now - time < OVER_MS);
  }
}
