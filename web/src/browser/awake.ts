// A screen that stays awake while the page is in sight. Browsers let pages of HTTPS and of this machine alone ask for it.

/** Where it was refused (a battery that is low), it is asked for again after so long, ms. */
const AGAIN_MS = 10_000;

type Lock = Pick<WakeLockSentinel, "released" | "release">;

export class Awake {
  private lock: Lock | null = null;
  private busy = false;
  private refusedAt = -Infinity;

  /** `request` gets the browser's lock; undefined where there is none to be had. */
  constructor(private readonly request: (() => Promise<Lock>) | undefined) {}

  get possible(): boolean {
    return this.request !== undefined;
  }

  /** Keeps the screen awake from now on, or no longer. The browser ends a lock by itself when the page is out of sight. */
  async want(wanted: boolean, now: number): Promise<void> {
    if (this.busy || !this.request) return;
    const held = this.lock !== null && !this.lock.released;
    if (wanted === held || (wanted && now - this.refusedAt < AGAIN_MS)) return;
    this.busy = true;
    try {
      if (wanted) this.lock = await this.request();
      else await this.lock?.release();
    } catch {
      this.refusedAt = now;
    }
    this.busy = false;
  }
}

/** The page's one. */
export const awake = new Awake(
  globalThis.navigator && "wakeLock" in navigator ? () => navigator.wakeLock.request("screen") : undefined,
);
