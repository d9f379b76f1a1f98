// What the rolling charts show: the newest minutes of something, oldest first.

/** How far back a trail goes, s. */
export const SPAN_S = 120;
/** Points kept at most. */
const MOST = 1500;
/** Nearer to the one before, a point is left out, s: no chart shows it apart, and the oldest are not to go for it. */
const APART_S = SPAN_S / MOST;

/** Earlier than the one before by more than this, a point is of a clock that was set back, s. */
const SET_BACK_S = 1;

export interface Trail<Point> {
  /** This page's clock, s. */
  at: number[];
  points: Point[];
}

export const noTrail = { at: [], points: [] };

/** The trail with a point more, where it is apart from the others, and without what is too old. */
export function follow<Point>(trail: Trail<Point>, atS: number, point: Point): Trail<Point> {
  const newest = trail.at.at(-1) ?? -Infinity;
  if (atS - newest < APART_S && newest - atS < SET_BACK_S) return trail;
  const oldest = atS - SPAN_S;
  let from = trail.at.findIndex((at) => at >= oldest);
  if (from < 0) from = trail.at.length;
  from = Math.max(from, trail.at.length - MOST + 1);
  // Where the clock was set back, what is later than now is no more.
  const kept = trail.at.slice(from).filter((at) => at < atS).length;
  const [at, points] = [trail.at.slice(from, from + kept), trail.points.slice(from, from + kept)];
  return { at: [...at, atS], points: [...points, point] };
}

/** The trail with what is known of it from elsewhere, oldest first: that fills what it lacks before and within. */
export function filled<Point>(trail: Trail<Point>, known: Trail<Point>): Trail<Point> {
  const [oldest, newest] = [known.at[0], known.at.at(-1)];
  if (oldest === undefined || newest === undefined) return trail;
  const part = (holds: (atS: number) => boolean) => ({
    at: trail.at.filter(holds),
    points: trail.points.filter((_, index) => holds(trail.at[index] ?? oldest)),
  });
  const [before, after] = [part((atS) => atS < oldest), part((atS) => atS > newest)];
  return {
    at: [...before.at, ...known.at, ...after.at],
    points: [...before.points, ...known.points, ...after.points],
  };
}

/** A spacing with its uncertainty and target, px. */
export interface SpacingPoint {
  spacingPx: number;
  sigmaPx: number;
  targetPx: number;
}

/** How clear the picture was: energy of gradient of the central view, mean a pixel; null where no view could be made. */
export type ClarityPoint = number | null;

/** Readbacks, mm; null while unknown. */
export interface AxesPoint {
  focusMm: number | null;
  eMm: number | null;
}
