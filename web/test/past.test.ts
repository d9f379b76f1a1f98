import { describe, expect, it } from "vitest";
import { FIRST_STEP_S, MOST, noPast, older, until, type Past } from "../src/charts/past";
import { filled, follow, noTrail, SPAN_S, whole, type Trail } from "../src/charts/trail";

const itself = (point: number) => point;

describe("the past of a chart", () => {
  it("is bounded over a day of readings, goes back to the first, and loses no leap", () => {
    let past: Past<number> = noPast;
    const leaps = [100.25, 4000.75, 40_000.25, 80_000.75];
    for (let minute = 0; minute < 24 * 60; minute += 1) {
      const at = Array.from({ length: 240 }, (_, quarter) => 60 * minute + quarter / 4);
      const points = at.map((atS) => (leaps.includes(atS) ? (atS > 30_000 ? -9 : 9) : Math.sin(atS)));
      past = older(past, at, points, itself);
      expect(past.at.length).toBeLessThanOrEqual(MOST);
    }
    expect(past.at.length).toBeGreaterThan(MOST / 3);
    expect(past.at[0]).toBeLessThan(past.stepS);
    expect(past.at).toEqual([...past.at].sort((one, other) => one - other));
    for (const leap of leaps) {
      expect(past.points[past.at.indexOf(leap)]).toBe(leap > 30_000 ? -9 : 9);
    }
  });

  it("keeps the least and the greatest of a stretch, in their order, and what is not known", () => {
    const at = [1, 1.1, 1.2, 1.3, 1.4];
    const of = (points: (number | null)[]) =>
      older<number | null>(noPast, at, points, (point) => point).points;
    expect(FIRST_STEP_S).toBe(0.5);
    expect(of([3, 1, 2, 5, 4])).toEqual([1, 5]);
    expect(of([3, 5, 2, 1, 4])).toEqual([5, 1]);
    expect(of([2, 2, 2, 2, 2])).toEqual([2, 2]);
    expect(of([3, null, 2, 5, 4])).toEqual([null, 5]);
  });

  it("forgets what is later than a clock that was set back", () => {
    const past = older(noPast, [1, 2, 3], [1, 2, 3], itself);
    expect(until(past, 2.5).points).toEqual([1, 2]);
    expect(until(past, 4)).toBe(past);
  });
});

describe("a trail with its past", () => {
  it("has everything since the page was opened, each point once and in order", () => {
    let trail: Trail<number> = noTrail;
    for (let second = 0; second < 1000; second += 1) trail = follow(trail, second, second, itself);
    expect(trail.at[0]).toBe(999 - SPAN_S);
    expect(whole(trail).at).toEqual(Array.from({ length: 1000 }, (_, second) => second));
    expect(whole(trail).points).toEqual(whole(trail).at);
  });

  it("takes what the daemon knows only where it has none of that time itself", () => {
    let trail: Trail<number> = noTrail;
    for (let second = 0; second < 300; second += 1) trail = follow(trail, second, second, itself);
    const known = { at: [170, 290], points: [-1, -2] };
    const at = whole(filled(trail, known)).at;
    expect(at).toEqual([...at].sort((one, other) => one - other));
    expect(at.slice(0, 3)).toEqual([0, 1, 2]);
    expect(at.filter((time) => time > 170 && time < 290)).toEqual([]);
  });
});
