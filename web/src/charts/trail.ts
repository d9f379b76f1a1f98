// What the charts show: the newest minutes of something as it came, and what was before, coarser; oldest first.

import { noPast, older, until, type Past, type Weigh } from "./past";

/** How far back it is as it came, s. */
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
  /** What was before. */
  past: Past<Point>;
}

export const noTrail = { at: [], points: [], past: noPast };

/** The trail with a point more, where it is apart from the others; what is old is of the past. */
export function follow<Point>(
  trail: Trail<Point>,
  atS: number,
  point: Point,
  weigh: Weigh<Point>,
): Trail<Point> {
  const newest = trail.at.at(-1) ?? -Infinity;
  if (atS - newest < APART_S && newest - atS < SET_BACK_S) return trail;
  const oldest = atS - SPAN_S;
  let from = trail.at.findIndex((at) => at >= oldest);
  if (from < 0) from = trail.at.length;
  from = Math.max(from, trail.at.length - MOST + 1);
  // Where the clock was set back, what is later than now is no more.
  const kept = trail.at.slice(from).filter((at) => at < atS).length;
  const [at, points] = [trail.at.slice(from, from + kept), trail.points.slice(from, from + kept)];
  const past = older(until(trail.past, atS), trail.at.slice(0, from), trail.points.slice(0, from), weigh);
  return { at: [...at, atS], points: [...points, point], past };
}

/** All of it. */
export function whole<Point>({ at, points, past }: Trail<Point>): Pick<Trail<Point>, "at" | "points"> {
  if (past.at.length === 0) return { at, points };
  return { at: [...past.at, ...at], points: [...past.points, ...points] };
}

/** The trail with what is known of it from elsewhere, oldest first: that fills what it lacks before and within. */
export function filled<Point>(trail: Trail<Point>, known: Pick<Trail<Point>, "at" | "points">): Trail<Point> {
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
    past: until(trail.past, before.at[0] ?? oldest),
  };
}

/** A spacing with its uncertainty and target, px. */
export interface SpacingPoint {
  spacingPx: number;
  sigmaPx: number;
  targetPx: number;
}

/** What leaps in a spacing is how far it is from its target. */
export const spacingWeight = ({ spacingPx, targetPx }: SpacingPoint) => spacingPx - targetPx;

/** How clear the picture was: energy of gradient of the central view, mean a pixel; null where no view could be made. */
export type ClarityPoint = number | null;

/** Readbacks, mm; null while unknown. */
export interface AxesPoint {
  focusMm: number | null;
  eMm: number | null;
}

export const clarityWeight = (point: ClarityPoint) => point;
/** Either axis's moves change it. */
export const axesWeight = ({ focusMm, eMm }: AxesPoint) =>
  focusMm === null && eMm === null ? null : (focusMm ?? 0) + (eMm ?? 0);
