// The focus meter's scale: fine about the target, coarse far from it, the same at all times so that the eye learns it.

/** The scale is linear within this distance from the target and logarithmic beyond, px. */
const LINEAR_PX = 0.02;
/** The scale's end, px. */
export const END_PX = 10;
/** Where the scale is marked, px from the target. */
export const MARKS_PX = [-10, -1, -0.1, 0, 0.1, 1, 10] as const;

const full = Math.asinh(END_PX / LINEAR_PX);

/** Place of a difference from the target on the meter: −1 at its left end, 0 at the target, 1 at its right end. */
export function place(differencePx: number): number {
  if (Number.isNaN(differencePx)) return 0;
  const share = Math.asinh(differencePx / LINEAR_PX) / full;
  return Math.min(1, Math.max(-1, share));
}

/** The stretch that a difference covers with `widths` standard uncertainties on either side. */
export function band(differencePx: number, sigmaPx: number, widths = 2): { from: number; to: number } {
  return { from: place(differencePx - widths * sigmaPx), to: place(differencePx + widths * sigmaPx) };
}

/** Whether a difference is beyond the scale's end. */
export function beyond(differencePx: number): boolean {
  return Math.abs(differencePx) > END_PX;
}

/** Decimals that a value with this uncertainty deserves: two digits of the uncertainty, 4 at most. */
export function digits(sigma: number): number {
  if (!(sigma > 0) || !Number.isFinite(sigma)) return 4;
  return Math.min(4, Math.max(0, 1 - Math.floor(Math.log10(sigma))));
}

/** An uncertainty changes by so much, either way, before a figure is given another number of decimals. */
const HOLD = 1.5;

/** The same, but as before while an uncertainty only just calls for others: a figure is not to change its length with each
 *  measurement. */
export function steadyDigits(sigma: number, before: number | null): number {
  const wanted = digits(sigma);
  const still = [digits(sigma * HOLD), digits(sigma / HOLD)];
  return before !== null && still.includes(before) ? before : wanted;
}
