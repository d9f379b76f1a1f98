import { describe, expect, it } from "vitest";
import { PageClock } from "../src/browser/page-clock";

/** A computer: one clock that nobody sets, and stands while it sleeps, and its wall clock. */
function computer(stepMs = 1) {
  const set = { unsetMs: 1_000_000, wallMs: 1_000_000 };
  const step = (ms: number) => Math.floor(ms / stepMs) * stepMs;
  /** A page's or a worker's, whose own clock began at another time. */
  const clockOf = (apartMs: number) =>
    new PageClock(
      () => step(set.unsetMs + apartMs),
      () => step(set.wallMs),
    );
  const clock = clockOf(37.3);
  const pass = (ms: number) => {
    set.unsetMs += ms;
    set.wallMs += ms;
    return clock.now();
  };
  return { set, clock, clockOf, pass };
}

describe("the page's clock", () => {
  it("is not set back with the computer's, while anything comes and while nothing does", () => {
    const { set, clock, pass } = computer();
    const began = clock.now();
    for (const byMs of [-3_600_000, -1000, -100]) set.wallMs += byMs;
    expect(pass(500) - began).toBe(500);
    set.wallMs -= 60_000;
    expect(pass(500) - began).toBe(1000);
  });

  it("goes on while the computer sleeps, also one that was set back before", () => {
    const { set, clock, pass } = computer();
    const began = clock.now();
    set.wallMs -= 60_000;
    expect(pass(250) - began).toBe(250);
    set.wallMs += 20_000;
    expect(pass(250) - began).toBe(20_500);
  });

  it("takes no pause between its readings for a leap", () => {
    const at = { unset: 0, wall: 0, pauseMs: 0 };
    const clock = new PageClock(
      () => at.unset,
      () => {
        at.unset += at.pauseMs;
        return at.wall;
      },
    );
    expect(clock.now()).toBe(0);
    at.pauseMs = 2000;
    expect(clock.now()).toBe(2000);
    Object.assign(at, { pauseMs: 0, wall: 2000 });
    expect(clock.now()).toBe(2000);
  });

  it("is the worker's, whenever that begins and whatever leaps it has seen", () => {
    const { set, clock, clockOf, pass } = computer();
    set.wallMs -= 60_000;
    pass(250);
    set.wallMs += 20_000;
    const told = pass(250);
    const late = clockOf(-500);
    late.follow(told);
    expect(late.now()).toBe(clock.now());
    // A leap that the page has seen half of: the worker's own does not count.
    set.wallMs += 3_600_000;
    late.now();
    set.wallMs -= 1000;
    const now = pass(250);
    late.follow(now);
    expect(late.now()).toBe(now);
    // A word that waited makes it no younger.
    pass(40);
    late.follow(now);
    expect(late.now()).toBe(clock.now());
  });

  it.each([1, 17, 100])("gains nothing by clocks that go by steps of %i ms", (stepMs) => {
    const { clock, pass } = computer(stepMs);
    const began = clock.now();
    for (let k = 0; k < 100_000; k += 1) pass(7);
    expect(Math.abs(clock.now() - began - 700_000)).toBeLessThanOrEqual(stepMs);
  });
});
