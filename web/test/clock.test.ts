import { describe, expect, it } from "vitest";
import { nextAt } from "../src/cadence";
import { ahead, answered, heard, lateness, secondsLeft, sentAt, unknown, type Clock } from "../src/clock";

const at = (second: number) => new Date(Date.UTC(2026, 0, 1, 0, 0, second));

describe("the daemon's clock", () => {
  const AHEAD = 5000;
  const tick = (second: number, waitedMs: number) =>
    [at(second).getTime() + AHEAD + waitedMs, at(second).toISOString()] as const;
  /** What the daemon answered at a second to what was under way so long, and came after it waited so long. */
  const answer = (second: number, underWayMs: number, waitedMs: number) => {
    const [cameAt, now] = tick(second, waitedMs);
    return [at(second).getTime() + AHEAD - underWayMs, cameAt, now] as const;
  };

  it("is told by the tick that waited least, until the daemon has answered", () => {
    expect(ahead(unknown)).toBeNull();
    let clock = heard(unknown, ...tick(0, 40));
    clock = heard(clock, ...tick(2, 3));
    clock = heard(clock, ...tick(4, 900));
    expect(ahead(clock)).toBe(AHEAD + 3);
    expect([lateness(unknown), lateness(clock), lateness(heard(clock, ...tick(6, 3)))]).toEqual([0, 897, 0]);
    expect(heard(clock, 0, "no time")).toBe(clock);
    expect(answered(clock, 0, 0, "no time")).toBe(clock);
    clock = answered(clock, ...answer(7, 2, 800));
    expect([ahead(clock), lateness(clock)]).toEqual([AHEAD - 2, 802]);
  });

  it("shows a line that stays late to be late, for as long as it is", () => {
    let clock = answered(unknown, ...answer(0, 5, 5));
    for (let second = 1; second <= 3600; second += 1) {
      clock = heard(clock, ...tick(second, 10_000));
      clock = answered(clock, ...answer(second, 10_000, 10_000));
    }
    expect(lateness(clock)).toBeGreaterThanOrEqual(10_000);
    // Two clocks may go apart a little meanwhile: nothing is younger by that.
    expect(lateness(clock)).toBeLessThan(12_000);
    const picture = { capturedAt: at(3600), ageMs: 30 };
    const cameAt = at(3600).getTime() + AHEAD + 10_030;
    expect(cameAt - sentAt(clock, picture, cameAt)).toBeGreaterThanOrEqual(10_000);
    // In order again.
    clock = answered(heard(clock, ...tick(3601, 4)), ...answer(3601, 4, 4));
    expect(lateness(clock)).toBeLessThan(10);
  });

  it("shows one to be late that was so from the first", () => {
    let clock = heard(unknown, ...tick(0, 8000));
    expect(lateness(clock)).toBe(0);
    clock = answered(clock, ...answer(1, 20, 8000));
    expect(lateness(clock)).toBe(8020);
  });

  it("is followed when either clock is set, forwards or back", () => {
    for (const byMs of [60_000, -60_000]) {
      let clock: Clock = unknown;
      for (let second = 0; second < 5; second += 1) clock = answered(clock, ...answer(second, 3, 3));
      const set = (values: readonly number[]) => values.map((value) => value + byMs) as [number, number];
      for (let second = 5; second < 7; second += 1) {
        const [cameAt, now] = tick(second, 3);
        clock = heard(clock, cameAt + byMs, now);
        const [asked, came, then] = answer(second, 3, 3);
        clock = answered(clock, ...set([asked, came]), then);
      }
      expect(Math.abs((ahead(clock) ?? 0) - AHEAD - byMs)).toBeLessThan(5);
      expect(lateness(clock)).toBeLessThan(10);
    }
    // This page's clock, between a question and its answer.
    const clock = answered(unknown, ...answer(0, 3, 3));
    expect(answered(clock, 1e15, 1e15 - 1, at(1).toISOString())).toBe(clock);
  });

  it("tells how long something lasts, whatever this page's clock says", () => {
    const now = at(10).getTime() + AHEAD;
    const clock = heard(unknown, ...tick(0, 0));
    expect(secondsLeft(at(40).toISOString(), clock, now)).toBe(30);
    expect(secondsLeft(at(9).toISOString(), clock, now)).toBe(0);
    expect(secondsLeft(at(40).toISOString(), unknown, now)).toBe(25);
  });

  it("tells when a picture was sent, however long it waited after", () => {
    const picture = { capturedAt: at(10), ageMs: 30 };
    const cameAt = at(10).getTime() + AHEAD + 430;
    expect(sentAt(unknown, picture, cameAt)).toBe(cameAt);
    const clock = heard(unknown, ...tick(0, 0));
    expect(sentAt(clock, picture, cameAt)).toBe(cameAt - 400);
    // A tick that waited longer than the picture does not make it younger than it is.
    expect(sentAt(heard(unknown, ...tick(0, 1000)), picture, cameAt)).toBe(cameAt);
  });
});

describe("the cadence of drawing", () => {
  it("leaves time for other things, and draws at once what was not drawn for long", () => {
    expect(nextAt(1000, 990, 2, 30)).toBe(1020);
    expect(nextAt(1000, 990, 80, 30)).toBe(1150);
    expect(nextAt(1000, 500, 80, 100)).toBe(1000);
  });
});
