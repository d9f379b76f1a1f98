import { describe, expect, it } from "vitest";
import { linesOf, surfaceOf } from "../src/picture/field-surface";
import type { FieldMap, Lens } from "../src/daemon/wire";

const PITCH = 30;
const SIDE = 20;
const MIDDLE = (PITCH * (SIDE - 1)) / 2;

/** Numbers that look random and are the same each time: standard deviation about 1. */
function noise(): () => number {
  let seed = 7;
  const next = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  return () => Array.from({ length: 12 }, next).reduce((sum, one) => sum + one, -6);
}

function map(error: (u: number, v: number) => number, sigmaPx = 0.02): FieldMap {
  const scatter = noise();
  const lenses = Array.from({ length: SIDE * SIDE }, (_, index): Lens => {
    const [x, y] = [PITCH * (index % SIDE), PITCH * Math.floor(index / SIDE)];
    const [u, v] = [(x - MIDDLE) / MIDDLE, (y - MIDDLE) / MIDDLE];
    return { x, y, spacingPx: 20 + error(u, v) + sigmaPx * scatter(), sigmaPx, fate: "matched" };
  });
  return { frameSeq: 1, pitchPx: PITCH, targetPx: 20, lenses };
}

describe("the surface", () => {
  it("is what tilt and curvature make, out of the scatter of single micro-images", () => {
    const surface = surfaceOf(map((u, v) => 1 + 0.3 * u - 0.2 * (u * u + v * v)));
    expect(surface?.at(MIDDLE, MIDDLE)).toBeCloseTo(1, 2);
    expect(surface?.at(2 * MIDDLE, MIDDLE)).toBeCloseTo(1.1, 1);
    expect(surface?.at(0, MIDDLE)).toBeCloseTo(0.5, 1);
    expect(surface?.field).toEqual({ left: 0, top: 0, right: 2 * MIDDLE, bottom: 2 * MIDDLE });
  });

  it("is not bent by a few that are far off", () => {
    const leaning = map((u) => 0.1 * u);
    for (const at of [3, 77, 200]) leaning.lenses[at]!.spacingPx = 40;
    expect(surfaceOf(leaning)?.at(MIDDLE, MIDDLE)).toBeCloseTo(0, 2);
  });

  it("is none where there is too little to fit it to", () => {
    const whole = map((u) => u);
    expect(surfaceOf({ ...whole, lenses: whole.lenses.slice(0, 11) })).toBeNull();
    // All in one row: nothing is known across it.
    expect(surfaceOf({ ...whole, lenses: whole.lenses.slice(0, SIDE) })).toBeNull();
    expect(
      surfaceOf({ ...whole, lenses: whole.lenses.map((lens) => ({ ...lens, fate: "blank" as const })) }),
    ).toBeNull();
  });
});

describe("the lines of equal spacing", () => {
  const lines = (error: (u: number, v: number) => number) => {
    const surface = surfaceOf(map(error));
    return surface ? linesOf(surface) : [];
  };

  it("are few, round, side by side across a tilt, the target's among them", () => {
    const tilted = lines((u) => 0.5 * u);
    expect(tilted.map(({ errorPx }) => errorPx).sort((one, other) => one - other)).toEqual([
      -0.4, -0.2, 0, 0.2, 0.4,
    ]);
    const target = tilted.find(({ errorPx }) => errorPx === 0);
    for (const [x1, , x2] of target?.pieces ?? []) {
      expect(Math.abs(x1 - MIDDLE)).toBeLessThan(10);
      expect(Math.abs(x2 - MIDDLE)).toBeLessThan(10);
    }
  });

  it("are rings where the field is curved, however far the target is", () => {
    const curved = lines((u, v) => 5 + 0.5 * (u * u + v * v));
    expect(curved.length).toBeGreaterThanOrEqual(4);
    const [ring] = curved.sort((one, other) => one.errorPx - other.errorPx).slice(1);
    const radii = (ring?.pieces ?? []).map(([x, y]) => Math.hypot(x - MIDDLE, y - MIDDLE));
    expect(Math.max(...radii) / Math.min(...radii)).toBeLessThan(1.2);
  });

  it("are none where there is nothing but scatter", () => {
    expect(lines(() => 0.3)).toEqual([]);
  });
});
