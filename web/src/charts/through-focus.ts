// A sweep as curves over the position: what was seen, and what was fitted to it.

import type { AlignedData } from "uplot";
import { inUnit, type LengthUnit } from "../words/units";
import type { AxisName, FittedPlace, Iteration } from "../daemon/wire";

/** Where an iteration's axis stood, in the unit; null where that is not known. */
function positionOf(it: Iteration, axis: AxisName, unit: LengthUnit): number | null {
  const mm = axis === "focus" ? it.focus_mm : it.e_mm;
  return typeof mm === "number" ? inUnit(mm, unit) : null;
}

type Value = number | null;
type Row = [x: number, ...values: Value[]];

/** Rows by position, as a chart takes them: a column for the positions, and one for each curve. */
function columns(rows: Row[], width: number): AlignedData {
  const sorted = [...rows].sort(([one], [other]) => one - other);
  const column = (at: number) => sorted.map((row) => row[at] ?? null);
  return [sorted.map(([x]) => x), ...Array.from({ length: width }, (_, n) => column(n + 1))];
}

const fitted = (best: FittedPlace | null | undefined, unit: LengthUnit) =>
  (best?.curve ?? []).map(({ position_mm: mm, value }): [number, number] => [inUnit(mm, unit), value]);

/** Position, ± 2 σ, target, spacing, and the curve through it. */
export function spacings(
  iterations: Iteration[],
  axis: AxisName,
  best: FittedPlace | null | undefined,
  unit: LengthUnit,
): AlignedData {
  const seen = iterations.flatMap((it): Row[] => {
    const x = positionOf(it, axis, unit);
    const { spacing_px: px, spacing_sigma_px: sigma } = it.spacing;
    return x === null ? [] : [[x, px - 2 * sigma, px + 2 * sigma, it.spacing_target_px, px, null]];
  });
  const curve = fitted(best, unit).map(([x, y]): Row => [x, null, null, null, null, y]);
  return columns([...seen, ...curve], 5);
}

/** Position, EOG, and the curve through the greatest of them. */
export function clarities(
  iterations: Iteration[],
  axis: AxisName,
  best: FittedPlace | null | undefined,
  unit: LengthUnit,
): AlignedData {
  const seen = iterations.flatMap((it): Row[] => {
    const x = positionOf(it, axis, unit);
    return x === null || typeof it.eog !== "number" ? [] : [[x, it.eog, null]];
  });
  return columns([...seen, ...fitted(best, unit).map(([x, y]): Row => [x, null, y])], 2);
}
