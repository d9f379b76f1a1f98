// An axis's travel as a scale.

import type { Bench } from "./wire";

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
