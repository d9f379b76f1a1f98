import { describe, expect, it, vi } from "vitest";
import { nextAt } from "../src/browser/cadence";
import {
  ahead,
  aheadOfWall,
  answered,
  clockAfter,
  heard,
  lateness,
  monotonicOf,
  secondsLeft,
  sentAt,
  unknown,
  type Clock,
} from "../src/daemon/clock";
import { told } from "./fixtures";

const at = (second: number) => new Date(Date.UTC(2026, 0, 1, 0, 0, second));

describe("the daemon's clock", () => {
  const AHEAD = 5000;
  const tick = (second: number, waitedMs: number) =>
    [at(second).getTime() + AHEAD + waitedMs, told(at(second).toISOString())] as const;
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
    expect(heard(clock, 0, told("no time"))).toBe(clock);
    expect(answered(clock, 0, 0, told("no time"))).toBe(clock);
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
    const picture = { monotonicMs: at(3600).getTime(), ageMs: 30 };
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

  it("is that which nobody sets: a wall clock set by less than a line is late makes nothing younger", () => {
    const LATE = 3000;
    for (const byMs of [2000, -2000]) {
      let clock = answered(unknown, ...answer(0, 5, LATE));
      const set = (second: number) => {
        const [asked, came] = answer(second, LATE, LATE);
        return [asked, came, told(new Date(at(second).getTime() + byMs).toISOString(), byMs)] as const;
      };
      for (let second = 1; second < 10; second += 1) {
        const [, came, then] = set(second);
        clock = answered(heard(clock, came, then), ...set(second));
      }
      expect(Math.abs(lateness(clock) - LATE)).toBeLessThan(20);
      const picture = { monotonicMs: at(10).getTime(), ageMs: 30 };
      const cameAt = at(10).getTime() + AHEAD + 30 + LATE;
      expect(cameAt - sentAt(clock, picture, cameAt)).toBeGreaterThanOrEqual(LATE);
      // What is told in hours and minutes goes by the clock as it is set now.
      const now = at(10).getTime() + AHEAD;
      expect(secondsLeft(new Date(at(40).getTime() + byMs).toISOString(), clock, now)).toBe(30);
      expect(monotonicOf(clock, at(10).getTime() + byMs)).toBeCloseTo(at(10).getTime(), 6);
    }
    expect([aheadOfWall(unknown), monotonicOf(unknown, 0)]).toEqual([null, null]);
  });

  const message = (boot_id: string, second: number, asked_ms: number) =>
    ({ type: "clock", seq: 1, boot_id, asked_ms, ...told(at(second).toISOString()) }) as const;

  it("is another one with another run of the daemon, which may be on a machine started anew", () => {
    const [asked, came] = answer(1000, 5, 5);
    const old = clockAfter(unknown, message("a", 1000, asked), came);
    expect(ahead(old)).toBe(AHEAD - 5);
    // Its clock began anew, behind: by the old one all would be old.
    const anew = clockAfter(old, message("b", 3, asked + 5000), came + 5000);
    expect(ahead(anew)).toBe(asked + 5000 - at(3).getTime());
    expect(lateness(anew)).toBe(10);
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
    // What was not asked yet is no answer.
    const clock = answered(unknown, ...answer(0, 3, 3));
    expect(answered(clock, 1e15, 1e15 - 1, told(at(1).toISOString()))).toBe(clock);
  });

  it("tells how long something lasts, whatever this page's clock says", () => {
    const now = at(10).getTime() + AHEAD;
    const clock = heard(unknown, ...tick(0, 0));
    expect(secondsLeft(at(40).toISOString(), clock, now)).toBe(30);
    expect(secondsLeft(at(9).toISOString(), clock, now)).toBe(0);
    expect(secondsLeft(at(40).toISOString(), unknown, now)).toBe(25);
  });

  it("tells when a picture was sent, however long it waited after", () => {
    const picture = { monotonicMs: at(10).getTime(), ageMs: 30 };
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

describe("clocks that a browser has go by coarse steps", () => {
  /** A page's clocks go by steps of so many ms; how far what is known of the daemon's is off then within ten minutes, ms, and
   *  how late the line then seems. */
  async function known(stepMs: number) {
    const began = Date.UTC(2026, 0, 1);
    const page = (at: number) => Math.floor((began + at) / stepMs) * stepMs;
    let readings = 0;
    const now = vi.spyOn(performance, "now").mockImplementation(() => page((readings += 1e-4)));
    vi.resetModules();
    const fresh = await import("../src/daemon/clock");
    now.mockRestore();
    let clock = fresh.unknown;
    const offMs: number[] = [];
    const lateMs: number[] = [];
    for (let k = 0; k < 1200; k += 1) {
      const sent = 487 * k + ((k * 7919) % 41);
      const [asked, came] = [sent - 2, sent + 3];
      const what = {
        boot_id: "a run",
        seq: k,
        now: new Date(began + sent).toISOString(),
        monotonic_us: 1000 * sent,
      };
      clock =
        k % 10 === 9
          ? fresh.clockAfter(clock, { type: "clock", asked_ms: page(asked), ...what }, page(came))
          : fresh.clockAfter(clock, { type: "tick", ...what }, page(came));
      offMs.push(Math.abs(fresh.ahead(clock)! - began));
      lateMs.push(fresh.lateness(clock));
    }
    return [Math.max(...offMs), Math.max(...lateMs)] as const;
  }

  it.each([1, 17, 100])("and is off by little more than a step of %i ms", async (stepMs) => {
    const [offMs, lateMs] = await known(stepMs);
    expect(offMs).toBeLessThan(stepMs + 10);
    expect(lateMs).toBeLessThan(stepMs + 15);
  });
});
