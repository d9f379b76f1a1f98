// Where things stand in the drawing of a set-up: along the axis to scale, across it as it is told best.

/** The drawing's size; the camera looks to the left, from its right end. */
export const SIZE = { width: 320, height: 120 };
/** The lens's principal point, and the axis. */
export const LENS_X = 236;
export const AXIS_Y = 56;
/** Left of this nothing stands. */
const FAR_X = 14;
/** The shell's outer vertex and its two radii; its centre is at the lens, as joint optimisation has it about. */
export const SHELL = { vertexX: LENS_X - 36, outer: 36, inner: 31 };

export interface Board {
  x: number;
  /** Ends of the board across the axis. */
  top: number;
  bottom: number;
  distanceMm: number;
}

const HALF = 38;

/** Boards at distances from the lens: one that is flat, or the levels of one, the nearest lowest, as on a staircase. */
export function boardsAt(distancesMm: readonly number[]): Board[] {
  const apart = [...new Set(distancesMm)].sort((one, other) => one - other);
  const farthest = Math.max(...apart);
  const high = (2 * HALF) / apart.length;
  return apart.map((distanceMm, level) => {
    const bottom = AXIS_Y + HALF - level * high;
    return {
      x: LENS_X - ((LENS_X - FAR_X) * distanceMm) / farthest,
      top: bottom - high,
      bottom,
      distanceMm,
    };
  });
}

/** A flat board in the water, at the far end of what is drawn. */
export function boardInWater(distanceMm: number): Board {
  return { x: FAR_X + 12, top: AXIS_Y - HALF + 10, bottom: AXIS_Y + HALF, distanceMm };
}

/** Full stops as a lens's ring has them. */
const STOPS = [1, 1.4, 2, 2.8, 4, 5.6, 8, 11, 16, 22];
/** Full stops to either side of what is set. */
const REACH = 1.6;
const STOP_PX = 60;

/** Where the marks of the ring lie, the one to be set in the middle. */
export function ringAbout(number: number): { x: number; stop: number }[] {
  const off = (stop: number) => 2 * Math.log2(stop / number);
  return STOPS.filter((stop) => Math.abs(off(stop)) <= REACH).map((stop) => ({
    x: SIZE.width / 2 + STOP_PX * off(stop),
    stop,
  }));
}

/** Half the opening of an iris whose rim is 1, so that a wide one and a narrow one are told apart. */
export function opening(number: number): number {
  return Math.min(0.92, Math.max(0.12, 1.4 / number));
}

/** The six blades' opening, as points. */
export function iris(x: number, y: number, radius: number): string {
  const corner = (n: number) => (Math.PI / 3) * n + 0.2;
  const point = (n: number) =>
    `${(x + radius * Math.cos(corner(n))).toFixed(1)},${(y + radius * Math.sin(corner(n))).toFixed(1)}`;
  return Array.from({ length: 6 }, (_, n) => point(n)).join(" ");
}
