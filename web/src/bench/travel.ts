// An axis's travel as a scale.

import type { Axis, Bench, Side } from "../daemon/wire";

export interface Scale {
  low: number;
  high: number;
  /** The e wall, where the axis has one. */
  wall: number | null;
}

/** The stretch an axis's scale shows: its travel, and a little beyond the wall so that the wall is seen. */
export function axisScale(bench: Bench, axis: Bench["axes"][number]): Scale {
  const wall = axis.axis === "e" ? bench.e_wall_mm : null;
  const low = Math.min(axis.low_limit_mm, wall ?? axis.low_limit_mm, axis.position_mm ?? Infinity);
  const high = Math.max(axis.high_limit_mm, axis.position_mm ?? -Infinity);
  const margin = (high - low) * 0.06;
  return { low: low - margin, high: high + margin, wall };
}

/** A position on a scale, 0 to 1. */
export function along(scale: Scale, position: number): number {
  const share = (position - scale.low) / (scale.high - scale.low);
  return Math.min(1, Math.max(0, share));
}

/** By so much an axis may stand beside where it was told to go, mm. */
const BESIDE_MM = 0.01;
/** So near to where it may go an axis is taken to have come up against it, mm. */
const NEAR_MM = 0.05;

/** Where an axis stands, mm; null where that is not known. */
export function placeOf(axis: Axis): number | null {
  return axis.homed ? (axis.position_mm ?? null) : null;
}

/** The end of its travel that an axis stands beyond: the wall was not there when it went. */
export function sideBeyond(axis: Axis): Side | null {
  const at = placeOf(axis);
  if (at === null) return null;
  if (at < axis.low_limit_mm - BESIDE_MM) return "low";
  return at > axis.high_limit_mm + BESIDE_MM ? "high" : null;
}

/** Whether an axis stands where it may go no nearer to the shell. */
export function nearWall(axis: Axis): boolean {
  const at = placeOf(axis);
  return at !== null && at < axis.low_limit_mm + NEAR_MM;
}
