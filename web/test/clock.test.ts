import { describe, expect, it } from "vitest";
import { nextAt } from "../src/cadence";
import { ahead, heard, lateness, secondsLeft, sentAt, unknown } from "../src/clock";

const at = (second: number) => new Date(Date.UTC(2026, 0, 1, 0, 0, second));

describe("the daemon's clock", () => {
  const AHEAD = 5000;
  const tick = (second: number, waitedMs: number) =>
    [at(second).getTime() + AHEAD + waitedMs, at(second).toISOString()] as const;

  it("is told by the tick that waited least", () => {
    expect(ahead(unknown)).toBeNull();
    let clock = heard(unknown, ...tick(0, 40));
    clock = heard(clock, ...tick(2, 3));
    clock = heard(clock, ...tick(4, 900));
    expect(ahead(clock)).toBe(AHEAD + 3);
    expect([lateness(unknown), lateness(clock), lateness(heard(clock, ...tick(6, 3)))]).toEqual([0, 897, 0]);
    expect(heard(clock, 0, "no time")).toBe(clock);
  });

  it("is followed when it is set", () => {
    let clock = heard(unknown, ...tick(0, 0));
    for (let second = 2; second < 24; second += 1) clock = heard(clock, ...tick(second, 60_000));
    expect(ahead(clock)).toBe(AHEAD + 60_000);
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
