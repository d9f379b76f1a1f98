// How fast an axis goes while a button is held.

export const PACES = ["slow", "fast"] as const;
export type Pace = (typeof PACES)[number];

/** mm/s; null for the axis's greatest. A slow jog goes 0.15 mm after the last word at most. */
export const SPEED_MM_PER_S: Record<Pace, number | null> = { slow: 0.5, fast: null };

/** A move by more than this is asked about before it is made, mm. */
export const LARGE_STEP_MM = 1;

export function isLarge(fromMm: number, toMm: number): boolean {
  return Math.abs(toMm - fromMm) > LARGE_STEP_MM + 1e-9;
}
