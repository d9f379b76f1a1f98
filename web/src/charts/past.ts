// What is older than the newest minutes, for as long as the page is open: coarser the longer that is, so that it never takes more
// memory than a chart has use for. Of each stretch of time the least and the greatest are kept: no leap is lost.

/** Points kept at most. */
export const MOST = 4000;
/** Stretches of time that are told apart at first, s. */
export const FIRST_STEP_S = 0.5;

export interface Past<Point> {
  /** Stretches of time that are told apart, s. */
  stepS: number;
  /** This page's clock, s; two of a stretch at most, oldest first. */
  at: number[];
  points: Point[];
}

export const noPast = { stepS: FIRST_STEP_S, at: [], points: [] };

/** How large a point is; what is null is less than all others, so that a gap stays one. */
export type Weigh<Point> = (point: Point) => number | null;

/** The past with points that have become old, oldest first and later than what it has. */
export function older<Point>(
  past: Past<Point>,
  at: number[],
  points: Point[],
  weigh: Weigh<Point>,
): Past<Point> {
  if (at.length === 0) return past;
  const next = { stepS: past.stepS, at: [...past.at], points: [...past.points] };
  at.forEach((atS, index) => add(next, atS, points[index] as Point, weigh));
  return next.at.length > MOST ? coarser(next, weigh) : next;
}

/** Without what is later than a time: a clock was set back to it. */
export function until<Point>(past: Past<Point>, atS: number): Past<Point> {
  const kept = past.at.filter((at) => at < atS).length;
  if (kept === past.at.length) return past;
  return { ...past, at: past.at.slice(0, kept), points: past.points.slice(0, kept) };
}

function coarser<Point>(past: Past<Point>, weigh: Weigh<Point>): Past<Point> {
  let next = past;
  // With room to spare: it is not made coarser with each point.
  while (next.at.length > 0.75 * MOST) {
    const { at, points } = next;
    const coarse: Past<Point> = { stepS: 2 * next.stepS, at: [], points: [] };
    at.forEach((atS, index) => add(coarse, atS, points[index] as Point, weigh));
    next = coarse;
  }
  return next;
}

/** Adds a point in place; of three of a stretch the one that is neither least nor greatest goes. */
function add<Point>(past: Past<Point>, atS: number, point: Point, weigh: Weigh<Point>): void {
  const { at, points, stepS } = past;
  const stretch = (time: number) => Math.floor(time / stepS);
  at.push(atS);
  points.push(point);
  const third = at.length - 3;
  if (third < 0 || stretch(at[third] as number) !== stretch(atS)) return;
  const sizes = points.slice(third).map((of) => weigh(of) ?? -Infinity);
  const gone = 3 - sizes.indexOf(Math.min(...sizes)) - sizes.lastIndexOf(Math.max(...sizes));
  at.splice(third + gone, 1);
  points.splice(third + gone, 1);
}
