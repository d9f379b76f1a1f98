// This page's one clock. Ages are told by it, also while the connection is lost and nothing comes that would put them right.
// It goes on while the computer sleeps and is never set back; the page's worker goes by it, too.

/** A wall clock that leaps forwards by more than this was set, or its computer has slept, ms: one that goes by coarse steps
 *  does less. */
const LEAP_MS = 250;
/** Two clocks read further apart than this, ms, say nothing of a leap. */
const PAUSE_MS = 50;

/** By a clock that nobody sets, which may stand while the computer sleeps, and the leaps forwards of a wall clock; a worker's
 *  by what its page says. */
export class PageClock {
  private aheadMs = 0;
  private apartMs: number;
  private follows = false;

  constructor(
    private readonly unset: () => number,
    private readonly wall: () => number,
  ) {
    this.apartMs = wall() - unset();
  }

  /** ms since 1970, as far as the computer's clock was right when the page was opened. */
  now(): number {
    const before = this.unset();
    const wall = this.wall();
    const unset = this.unset();
    if (!this.follows && Math.abs(unset - before) <= PAUSE_MS) {
      const leapMs = wall - unset - this.apartMs;
      if (leapMs > LEAP_MS) this.aheadMs += leapMs;
      this.apartMs += leapMs;
    }
    return unset + this.aheadMs;
  }

  /** Goes by what the page says from now on: what its clock was when it said so, ms. Words take their time, by which this clock
   *  is behind, and what comes by it older; the quickest counts. */
  follow(at: number): void {
    const aheadMs = at - this.unset();
    this.aheadMs = this.follows ? Math.max(this.aheadMs, aheadMs) : aheadMs;
    this.follows = true;
  }
}

// Some browsers read it off the wall clock anew each time.
const origin = performance.timeOrigin;
const clock = new PageClock(
  () => origin + performance.now(),
  () => Date.now(),
);

/** This page's clock, ms. */
export const pageNow = () => clock.now();

/** In a worker, whose page says what its clock is, ms. */
export const followPage = (at: number) => clock.follow(at);
