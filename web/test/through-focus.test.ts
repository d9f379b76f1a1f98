import { expect, it } from "vitest";
import { clarities, spacings } from "../src/charts/through-focus";
import type { FittedPlace, Iteration } from "../src/daemon/wire";

const seen = (focus: number | null, px: number, eog: number | null) =>
  ({
    focus_mm: focus,
    e_mm: 7,
    spacing: { spacing_px: px, spacing_sigma_px: 0.01 },
    spacing_target_px: 20,
    eog,
  }) as unknown as Iteration;
const best: FittedPlace = {
  position_mm: 2.1,
  sigma_mm: 0.01,
  points: 5,
  curve: [
    { position_mm: 2, value: 20.1 },
    { position_mm: 2.2, value: 19.9 },
  ],
};

it("a sweep is sorted by position, with what was fitted among what was seen", () => {
  const swept = [seen(2.3, 19.8, 30), seen(1.9, 20.2, 40), seen(null, 18, 1), seen(2.1, 20, null)];
  const [x, low, high, target, spacing, curve] = spacings(swept, "focus", best, "µm");
  expect(x).toEqual([1900, 2000, 2100, 2200, 2300]);
  expect(spacing).toEqual([20.2, null, 20, null, 19.8]);
  expect(curve).toEqual([null, 20.1, null, 19.9, null]);
  expect(target).toEqual([20, null, 20, null, 20]);
  expect(low?.[0]).toBeCloseTo(20.18);
  expect(high?.[0]).toBeCloseTo(20.22);
  expect(clarities(swept, "focus", null, "mm")).toEqual([
    [1.9, 2.3],
    [40, 30],
    [null, null],
  ]);
  expect(clarities([], "e", null, "mm")).toEqual([[], [], []]);
});
