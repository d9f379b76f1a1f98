import { describe, expect, it } from "vitest";
import { greyOf, isOfAnotherPlace, spacingIn } from "../src/picture/region";
import { covers } from "../src/picture/region-watch";
import type { FieldMap, Lens } from "../src/daemon/wire";
import { measurement } from "./fixtures";

const PITCH = 30;
const SIDE = 12;

/** Evenly distributed in −√3 to √3, so that its standard deviation is 1; the same numbers each time. */
function noise(seed: number): () => number {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return (state / 2 ** 31 - 1) * Math.sqrt(3);
  };
}

/** A square array whose pairs of neighbours scatter by `sigma`: what a micro-image says is the mean of its pairs. */
function field(of: (x: number, y: number) => number, sigma: number, next: () => number): FieldMap {
  const sums = new Map<string, { sum: number; count: number }>();
  const count = (column: number, row: number, value: number) => {
    const at = sums.get(`${column} ${row}`) ?? { sum: 0, count: 0 };
    sums.set(`${column} ${row}`, { sum: at.sum + value, count: at.count + 1 });
  };
  for (let row = 0; row < SIDE; row += 1)
    for (let column = 0; column < SIDE; column += 1)
      for (const [right, down] of [
        [1, 0],
        [0, 1],
      ] as const) {
        if (column + right >= SIDE || row + down >= SIDE) continue;
        const value = sigma * next();
        count(column, row, value);
        count(column + right, row + down, value);
      }
  const lenses: Lens[] = [];
  for (let row = 0; row < SIDE; row += 1)
    for (let column = 0; column < SIDE; column += 1) {
      const { sum, count } = sums.get(`${column} ${row}`) ?? { sum: 0, count: 1 };
      const [x, y] = [PITCH * (column + 0.5), PITCH * (row + 0.5)];
      const sigmaPx = sigma / Math.sqrt(count);
      lenses.push({ x, y, spacingPx: of(x, y) + sum / count, sigmaPx, fate: "matched" });
    }
  return { frameSeq: 7, pitchPx: PITCH, targetPx: 20, lenses };
}

const all = { x: 0, y: 0, width: PITCH * SIDE, height: PITCH * SIDE };

describe("the spacing within a region", () => {
  it("scatters by what is said of it, although neighbours share their pairs", () => {
    const next = noise(1);
    const found = Array.from({ length: 400 }, () =>
      spacingIn(
        field(() => 20, 0.05, next),
        all,
      ),
    );
    const off = found.map((one) => (one?.spacingPx ?? NaN) - 20);
    const scatter = Math.sqrt(off.reduce((sum, one) => sum + one * one, 0) / off.length);
    const said = found.reduce((sum, one) => sum + (one?.sigmaPx ?? NaN), 0) / found.length;
    expect(found[0]).toMatchObject({ lenses: SIDE * SIDE, frameSeq: 7, targetPx: 20 });
    expect(scatter / said).toBeGreaterThan(0.85);
    expect(scatter / said).toBeLessThan(1.1);
  });

  it("is that of its own part: of a field that leans each half says another", () => {
    const map = field((x) => 20 + x / 1000, 1e-4, noise(2));
    const [left, right] = [
      spacingIn(map, { ...all, width: 180 }),
      spacingIn(map, { ...all, x: 180, width: 180 }),
    ];
    for (const [found, middle] of [
      [left, 20.09],
      [right, 20.27],
    ] as const) {
      expect(Math.abs((found?.spacingPx ?? NaN) - middle)).toBeLessThan(3 * (found?.sigmaPx ?? NaN));
      // What leans within it is no scatter.
      expect(found?.sigmaPx).toBeLessThan(3e-5);
    }
  });

  it("scatters by what is said of it where the field leans and curves, too", () => {
    const next = noise(4);
    const of = (x: number, y: number) => 20 + x / 1000 + ((x - 180) ** 2 + (y - 180) ** 2) / 2e5;
    const part = { x: 30, y: 60, width: 210, height: 240 };
    const found = Array.from({ length: 300 }, () => spacingIn(field(of, 0.05, next), part));
    const mean = found.reduce((sum, one) => sum + (one?.spacingPx ?? NaN), 0) / found.length;
    const square = found.reduce((sum, one) => sum + ((one?.spacingPx ?? NaN) - mean) ** 2, 0);
    const said = found.reduce((sum, one) => sum + (one?.sigmaPx ?? NaN), 0) / found.length;
    const scatter = Math.sqrt(square / found.length);
    const still = spacingIn(
      field(of, 1e-6, () => 0),
      part,
    );
    expect(Math.abs(mean - (still?.spacingPx ?? NaN))).toBeLessThan((4 * scatter) / Math.sqrt(found.length));
    expect(scatter / said).toBeGreaterThan(0.8);
    expect(scatter / said).toBeLessThan(1.15);
  });

  it("is told of a single row of micro-images, too", () => {
    const map = field(() => 20, 0.01, noise(5));
    const row = spacingIn(map, { ...all, height: PITCH });
    expect(row?.lenses).toBe(SIDE);
    expect(Math.abs((row?.spacingPx ?? NaN) - 20)).toBeLessThan(4 * (row?.sigmaPx ?? NaN));
  });

  it("is none where too few were measured, and counts no others", () => {
    const map = field(() => 20, 0.01, noise(3));
    expect(spacingIn(map, { x: 0, y: 0, width: 45, height: 45 })).toBeNull();
    expect(spacingIn(map, { x: 0, y: 0, width: 60, height: 60 })?.lenses).toBe(4);
    const blank = {
      ...map,
      lenses: map.lenses.map((lens, at) => (at === 0 ? { ...lens, fate: "blank" as const } : lens)),
    };
    expect(spacingIn(blank, { x: 0, y: 0, width: 60, height: 60 })).toBeNull();
  });
});

it("a region is as bright as its pixels", () => {
  const pixels = [10, 20, 30, 255].flatMap((level) => [level, level, level, 255]);
  expect(greyOf(new Uint8ClampedArray(pixels))).toEqual({
    mean: 78.75,
    least: 10,
    most: 255,
    saturated: 0.25,
  });
});

it("a picture of a part has all of a region, or it says nothing of it", () => {
  const part = {
    x_px: 10,
    y_px: 10,
    width_px: 20,
    height_px: 20,
    picture_width_px: 20,
    picture_height_px: 20,
    lossless: true,
  };
  expect(covers(part, { x: 10, y: 10, width: 20, height: 20 })).toBe(true);
  expect(covers(part, { x: 9, y: 10, width: 5, height: 5 })).toBe(false);
  expect(covers(part, { x: 26, y: 10, width: 5, height: 5 })).toBe(false);
});

describe("a region's spacing", () => {
  it("is of another place where an axis has gone since, or went then", () => {
    const seen = { ...measurement(19.7, 0.002), frame_seq: 7, settled: true, focus_mm: 2.095, e_mm: 1.82 };
    const at = (focusMm: number | null, eMm: number | null) => ({ focusMm, eMm });
    expect(isOfAnotherPlace(7, seen, at(2.0954, 1.82))).toBe(false);
    expect(isOfAnotherPlace(7, seen, at(1.7, 1.82))).toBe(true);
    expect(isOfAnotherPlace(7, seen, at(2.095, 2))).toBe(true);
    expect(isOfAnotherPlace(7, { ...seen, settled: false }, at(2.095, 1.82))).toBe(true);
    // Of what nothing is known nothing is said.
    expect(isOfAnotherPlace(7, seen, at(null, null)) || isOfAnotherPlace(8, seen, at(1.7, 1.82))).toBe(false);
    expect(isOfAnotherPlace(7, null, null)).toBe(false);
  });
});
