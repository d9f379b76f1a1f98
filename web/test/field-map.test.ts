import { describe, expect, it } from "vitest";
import { pairs, range, tint } from "../src/picture/field-map";
import { saturated } from "../src/picture/saturation";
import type { FieldMap, Lens } from "../src/daemon/wire";

const lens = (x: number, y: number, spacingPx = 20, fate: Lens["fate"] = "matched"): Lens => ({
  x,
  y,
  spacingPx,
  sigmaPx: 0.01,
  fate,
});
const map = (lenses: Lens[]): FieldMap => ({ frameSeq: 1, pitchPx: 30, targetPx: 20, lenses });

describe("pairs", () => {
  it("are neighbours that both match, each once, and no diagonals", () => {
    const grid = [0, 1, 2].flatMap((row) => [0, 1, 2].map((column) => lens(30 * column, 30 * row)));
    expect(pairs(map(grid))).toHaveLength(12);
    const one = grid.map((it, index) => (index === 4 ? { ...it, fate: "mismatched" as const } : it));
    expect(pairs(map(one))).toHaveLength(8);
    expect(pairs(map([]))).toEqual([]);
  });

  it("are six to a microlens on a hexagonal array", () => {
    const around = [0, 60, 120, 180, 240, 300].map((degrees) => {
      const angle = (degrees * Math.PI) / 180;
      return lens(100 + 30 * Math.cos(angle), 100 + 30 * Math.sin(angle));
    });
    expect(pairs(map([lens(100, 100), ...around]))).toHaveLength(12);
  });
});

describe("the tint", () => {
  it("is blue below the target and orange above, none on it or without a match", () => {
    expect(tint(lens(0, 0, 19.8), 20, 0.2)).toMatch(/^rgb\(40 110 255/);
    expect(tint(lens(0, 0, 20.2), 20, 0.2)).toMatch(/^rgb\(255 140 0/);
    expect(tint(lens(0, 0, 20), 20, 0.2)).toBeNull();
    expect(tint(lens(0, 0, 21, "blank"), 20, 0.2)).toBeNull();
    expect(tint(lens(0, 0, Infinity), 20, 0.2)).toBeNull();
  });

  it("is paler where the uncertainty is as large as the error", () => {
    const strength = (sigmaPx: number) =>
      Number(/\/ ([\d.]+)/.exec(tint({ ...lens(0, 0, 20.2), sigmaPx }, 20, 0.2) ?? "")?.[1]);
    expect(strength(0.2)).toBeLessThan(0.6 * strength(0.001));
    expect(tint({ ...lens(0, 0, 20.2), sigmaPx: Infinity }, 20, 0.2)).toBeNull();
  });

  it("has a range that nearly all are within", () => {
    const lenses = Array.from({ length: 100 }, (_, index) => lens(index, 0, 20 + index / 100));
    expect(range(map([...lenses, lens(0, 0, 90, "mismatched")]))).toBeCloseTo(0.95, 9);
    expect(range(map([]))).toBe(0.05);
  });
});

describe("saturation", () => {
  it("counts and marks the pixels that are full, and no others", () => {
    const pixels = new Uint8ClampedArray([255, 255, 255, 255, 10, 10, 10, 255, 251, 251, 251, 255]);
    expect(saturated(pixels)).toBe(2);
    expect(saturated(pixels, pixels)).toBe(2);
    expect([pixels[3], pixels[7], pixels[11]]).toEqual([255, 0, 255]);
  });
});
