// The spacing measured last, against what it is to be.

import type { Measurement } from "./wire";

/** Which way Δv or e has to go: a larger one makes the spacing smaller. */
export type Direction = "larger" | "smaller" | "there";

export interface Reading {
  spacingPx: number;
  sigmaPx: number;
  targetPx: number;
  differencePx: number;
  direction: Direction;
  inFocus: boolean;
}

/** The newest spacing against its target. */
export function reading(measurement: Measurement | null): Reading | null {
  if (!measurement) return null;
  const spacingPx = measurement.spacing.spacing_px;
  const sigmaPx = measurement.spacing.spacing_sigma_px;
  const targetPx = measurement.spacing_target_px;
  const differencePx = spacingPx - targetPx;
  const direction = Math.abs(differencePx) <= 2 * sigmaPx ? "there" : differencePx > 0 ? "larger" : "smaller";
  return { spacingPx, sigmaPx, targetPx, differencePx, direction, inFocus: measurement.in_focus };
}

/** The measurement that came closest to its target, and where the axes stood. */
export interface Best {
  differencePx: number;
  sigmaPx: number;
  targetPx: number;
  focusMm: number | null;
  eMm: number | null;
}

/** The best so far with a new measurement. Another target begins anew: what was best for the old one says nothing. */
export function best(held: Best | null, measurement: Measurement): Best {
  const now = measurement.spacing.spacing_px - measurement.spacing_target_px;
  if (
    held &&
    held.targetPx === measurement.spacing_target_px &&
    Math.abs(held.differencePx) <= Math.abs(now)
  ) {
    return held;
  }
  return {
    differencePx: now,
    sigmaPx: measurement.spacing.spacing_sigma_px,
    targetPx: measurement.spacing_target_px,
    focusMm: measurement.focus_mm ?? null,
    eMm: measurement.e_mm ?? null,
  };
}
