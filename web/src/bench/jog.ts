// Press and hold: an axis moves for as long as the press is told again and again, and the daemon's deadman ends the
// motion 0.3 s after the last word. Nothing is told after the release, and what was on its way then is taken back.

import { pageNow } from "../browser/page-clock";
import { MOVING } from "../daemon/over";
import type { AxisName, Problem, Side } from "../daemon/wire";

/** Between two words; the daemon waits 300 ms. */
export const BEAT_MS = 100;
/** After so long without a word the axis has stood for a while, ms: the computer has slept, or the network was away, and nobody
 *  is to find it moving on. */
export const LAPSE_MS = 1000;

/** So long a press waits for that of the press before it to stand, once its end is answered, ms: whoever turns round presses
 *  sooner than an axis stands. No other motion is waited for: a press is not to begin between two pieces of it. */
export const TURN_MS = 800;

export interface Press {
  axis: AxisName;
  towards: Side;
  speedMmPerS: number | null;
}

export interface JogCalls {
  /** Tells that the press of this name goes on; the problem, if there is one. */
  go(press: Press, name: string): Promise<Problem | null>;
  /** Ends the motion at once. */
  end(axis: AxisName): Promise<Problem | null>;
  /** What went wrong, for the operator. */
  failed(problem: Problem): void;
  /** Whether something is pressed. */
  changed(press: Press | null): void;
}

export class Jog {
  private press: Press | null = null;
  private name = "";
  private timer: ReturnType<typeof setInterval> | null = null;
  private onTheWay = false;
  private toldAt = 0;
  private begunAt = 0;
  private endedAt = -Infinity;
  /** Whether this press follows another one so closely that it may have to wait. */
  private waits = false;
  private ends = 0;

  constructor(private readonly calls: JogCalls) {}

  get pressed(): Press | null {
    return this.press;
  }

  /** One press at a time: another one ends it first. */
  begin(press: Press): void {
    this.release();
    this.press = press;
    // By it the daemon tells a press that is over from a new one, although both are the same button's.
    this.name = `${Date.now().toString(36)}-${Math.random().toString(36).slice(2)}`;
    this.calls.changed(press);
    this.toldAt = this.begunAt = pageNow();
    this.waits = this.begunAt - this.endedAt < TURN_MS;
    this.timer = setInterval(() => void this.tell(press), BEAT_MS);
    void this.tell(press);
  }

  release(): void {
    const press = this.press;
    if (press === null) return;
    this.press = null;
    if (this.timer !== null) clearInterval(this.timer);
    this.timer = null;
    this.endedAt = pageNow();
    this.calls.changed(null);
    void this.end(press);
  }

  private async tell(press: Press): Promise<void> {
    // A slow answer is waited for: words do not pile up, and the deadman decides meanwhile.
    // And an end of the press before must not overtake this one's beginning, or it would be its own.
    if (this.onTheWay || this.ends > 0 || this.press !== press) return;
    if (pageNow() - this.toldAt > LAPSE_MS) return this.release();
    this.toldAt = pageNow();
    this.onTheWay = true;
    const problem = await this.calls.go(press, this.name);
    this.onTheWay = false;
    if (this.press !== press) {
      // Released meanwhile: this word may have come after the end.
      if (problem === null) await this.end(press);
    } else if (problem === null) {
      this.waits = false;
    } else if (!this.waits || problem.type !== MOVING || pageNow() - this.begunAt > TURN_MS) {
      this.release();
      this.calls.failed(problem);
    }
  }

  private async end(press: Press): Promise<void> {
    this.ends += 1;
    const problem = await this.calls.end(press.axis);
    this.ends -= 1;
    // The axis comes to rest from then on, however late the answer was.
    if (this.waits) this.begunAt = pageNow();
    if (problem) this.calls.failed(problem);
    if (this.press !== null) await this.tell(this.press);
  }
}
