// The spacing over the field as a smooth surface: on axis, tilt and curvature, fitted to what each micro-image says, and
// the lines of equal spacing on it. Single micro-images scatter; what they have in common is how the array leans.

import { dot, fit, type Fit } from "./least-squares";
import type { FieldMap, Lens } from "../daemon/wire";

/** How much more uncertain what many micro-images say together is than had each its own pairs: a pair of neighbours counts
 *  in both of them. As a variance. */
export const SHARED = 2;
/** Micro-images that a surface takes at least. */
const LEAST = 12;
/** Those further from the surface than this many times the median distance are left out of the second fit. */
const STRAY = 6;
/** Standard uncertainties that the surface has to rise by to be more than scatter. */
const SIGMAS = 3;
/** Lines drawn at most, or one more. */
const LINES = 6;
/** Cells each way that lines are drawn from. */
const CELLS = 40;

export interface Surface {
  /** The error of the spacing, px, at a place in raw pixels. */
  at(x: number, y: number): number;
  /** The field it was fitted to, raw pixels. */
  field: { left: number; top: number; right: number; bottom: number };
  /** Between two lines of equal spacing, px; null where the surface is level within the scatter. */
  stepPx: number | null;
}

/** On axis, along x, along y, with the distance squared. */
type Row = [number, number, number, number];

/** The surface of a map; null where there is too little to fit one to. */
export function surfaceOf(map: FieldMap): Surface | null {
  const usable = map.lenses.filter(
    ({ fate, spacingPx, sigmaPx }) => fate === "matched" && Number.isFinite(spacingPx) && sigmaPx > 0,
  );
  if (usable.length < LEAST) return null;
  const [xs, ys] = [usable.map(({ x }) => x), usable.map(({ y }) => y)];
  const field = { left: least(xs), top: least(ys), right: most(xs), bottom: most(ys) };
  const middle = { x: (field.left + field.right) / 2, y: (field.top + field.bottom) / 2 };
  const half = Math.max(field.right - field.left, field.bottom - field.top) / 2;
  if (!(half > 0)) return null;
  const terms = (x: number, y: number): Row => {
    const [u, v] = [(x - middle.x) / half, (y - middle.y) / half];
    return [1, u, v, u * u + v * v];
  };
  const error = (lens: Lens) => lens.spacingPx - map.targetPx;
  const apart = (found: Fit, lens: Lens) => Math.abs(error(lens) - dot(found.of, terms(lens.x, lens.y)));
  const of = (lenses: Lens[]) =>
    fit(
      lenses.map(({ x, y }) => terms(x, y)),
      lenses.map(error),
      lenses.map(({ sigmaPx }) => sigmaPx),
    );
  const first = of(usable);
  if (!first) return null;
  const limit = STRAY * median(usable.map((lens) => apart(first, lens)));
  const kept = usable.filter((lens) => apart(first, lens) <= limit);
  const found = kept.length < LEAST ? first : (of(kept) ?? first);
  const at = (x: number, y: number) => dot(found.of, terms(x, y));
  return { at, field, stepPx: step(found) };
}

/** How far lines are apart: a round number that makes about so many of them. */
function step({ of, covariance, scatter }: Fit): number | null {
  const [, x, y, curve] = of as Row;
  const [, sigmaX, sigmaY, sigmaCurve] = covariance.map((line, i) =>
    Math.sqrt(Math.max(0, line[i]!) * scatter * SHARED),
  ) as Row;
  // From one end of the field to the other, and from its middle to a corner.
  const rise = Math.max(2 * Math.hypot(x, y), 2 * Math.abs(curve));
  const tilted = Math.hypot(x, y) > SIGMAS * Math.hypot(sigmaX, sigmaY);
  const curved = Math.abs(curve) > SIGMAS * sigmaCurve;
  if (!(rise > 0) || !(tilted || curved)) return null;
  const least = rise / LINES;
  const power = 10 ** Math.floor(Math.log10(least));
  return ([1, 2, 5, 10].find((factor) => factor * power >= least) ?? 10) * power;
}

/** A line of equal spacing: its error, px, and its pieces, raw pixels. */
export interface Line {
  errorPx: number;
  pieces: [x1: number, y1: number, x2: number, y2: number][];
}

/** The lines of equal spacing on a surface, the target's among them. */
export function linesOf({ at, field, stepPx }: Surface): Line[] {
  if (stepPx === null) return [];
  const place = (column: number, row: number): [number, number, number] => {
    const x = field.left + ((field.right - field.left) * column) / CELLS;
    const y = field.top + ((field.bottom - field.top) * row) / CELLS;
    return [x, y, at(x, y) / stepPx];
  };
  const lines = new Map<number, Line["pieces"]>();
  for (let row = 0; row < CELLS; row += 1) {
    for (let column = 0; column < CELLS; column += 1) {
      const corners = [
        place(column, row),
        place(column + 1, row),
        place(column + 1, row + 1),
        place(column, row + 1),
      ] as const;
      const heights = corners.map(([, , height]) => height);
      for (let level = Math.ceil(least(heights)); level <= most(heights); level += 1) {
        const crossed = corners.flatMap((from, index): [number, number][] => {
          const to = corners[(index + 1) % corners.length] ?? from;
          const [low, high] = [from[2] - level, to[2] - level];
          if (low < 0 === high < 0) return [];
          const share = low / (low - high);
          return [[from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])]];
        });
        const pieces = lines.get(level) ?? [];
        for (let at = 0; at + 1 < crossed.length; at += 2) {
          const [from, to] = [crossed[at], crossed[at + 1]];
          if (from && to) pieces.push([...from, ...to]);
        }
        lines.set(level, pieces);
      }
    }
  }
  return [...lines]
    .filter(([, pieces]) => pieces.length > 0)
    .map(([level, pieces]) => ({ errorPx: level * stepPx, pieces }));
}

function median(values: number[]): number {
  return [...values].sort((one, other) => one - other)[Math.floor(values.length / 2)] ?? 0;
}

function least(values: number[]): number {
  return values.reduce((low, value) => Math.min(low, value), Infinity);
}

function most(values: number[]): number {
  return values.reduce((high, value) => Math.max(high, value), -Infinity);
}
