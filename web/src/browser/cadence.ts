// How often the page's text, or its meter, is drawn: as often as it changes, unless that would leave the browser no time
// for anything else.

/** At most so often, ms; what changes by itself is not read as quickly as it changes. */
export const SOON_MS = 30;
export const LEISURELY_MS = 100;
/** Of its time the browser rests at least this many times what drawing took. */
const REST = 2;

/** When to draw next, of this clock: after the last one ended at `endedAt`, having taken `tookMs`. */
export function nextAt(now: number, endedAt: number, tookMs: number, everyMs: number): number {
  return Math.max(now, endedAt + Math.max(everyMs, REST * tookMs));
}

export class Cadence {
  private timer: ReturnType<typeof setTimeout> | null = null;
  private at = Infinity;
  private endedAt = -Infinity;
  private tookMs = 0;

  constructor(private readonly draw: () => void) {}

  /** Has it drawn once `everyMs` have gone by since it was drawn last. */
  due(everyMs: number): void {
    const now = performance.now();
    const at = nextAt(now, this.endedAt, this.tookMs, everyMs);
    if (at >= this.at) return;
    if (this.timer !== null) clearTimeout(this.timer);
    this.at = at;
    this.timer = setTimeout(() => this.run(), at - now);
  }

  private run(): void {
    this.timer = null;
    this.at = Infinity;
    const began = performance.now();
    this.draw();
    this.endedAt = performance.now();
    this.tookMs = this.endedAt - began;
    // What the browser makes of it comes after the frame's own scripts, and before the next task.
    requestAnimationFrame(() => {
      const laidOut = performance.now();
      setTimeout(() => {
        this.endedAt = performance.now();
        this.tookMs += this.endedAt - laidOut;
      });
    });
  }
}
