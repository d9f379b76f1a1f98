// What a part of the picture says for itself: its spacing, and how bright it is. Pure, so that it can be tested.

import { SHARED } from "./field-surface";
import { dot, fit } from "./least-squares";
import type { Region } from "./marks";
import { hasMoved } from "../job/moved-since";
import type { Reading } from "../meter/reading";
import { saturated } from "./saturation";
import type { FieldMap, Lens, Measurement } from "../daemon/wire";

/** Fewer micro-images say nothing of how far they scatter. */
const LEAST = 4;
/** Of fewer nobody knows whether they scatter or lean. */
const SMOOTH = 12;

export interface RegionSpacing {
  /** Mean over the micro-images whose centres are within, of a smooth surface through what each says. */
  spacingPx: number;
  /** Its standard uncertainty by noise and by scatter about that surface. What the whole frame has in common is not in it. */
  sigmaPx: number;
  targetPx: number;
  lenses: number;
  /** The frame that was measured. */
  frameSeq: number;
}

/** Whether a measured frame was of another place of the axes than the newest reading is, or of a motion, as far as is known. */
export function isOfAnotherPlace(
  frameSeq: number,
  measurement: Measurement | null,
  now: Pick<Reading, "focusMm" | "eMm"> | null,
): boolean {
  if (measurement?.frame_seq !== frameSeq) return false;
  const { settled, focus_mm, e_mm } = measurement;
  return !settled || hasMoved(focus_mm, now?.focusMm) || hasMoved(e_mm, now?.eMm);
}

/** The spacing within a region of a measured field; null where too few micro-images are. */
export function spacingIn(map: FieldMap, { x, y, width, height }: Region): RegionSpacing | null {
  // Centres count from the middle of the first pixel.
  const [left, top] = [x - 0.5, y - 0.5];
  const within = map.lenses.filter(
    (lens) =>
      lens.fate === "matched" &&
      lens.sigmaPx > 0 &&
      Number.isFinite(lens.spacingPx) &&
      lens.x >= left &&
      lens.y >= top &&
      lens.x < left + width &&
      lens.y < top + height,
  );
  if (within.length < LEAST) return null;
  // What leans or curves within is no scatter; in a single row of them it cannot be told.
  const leaning = within.length < SMOOTH ? null : meanOf(within, smooth({ x, y, width, height }));
  const mean = leaning ?? meanOf(within, () => [1]);
  return mean && { ...mean, targetPx: map.targetPx, lenses: within.length, frameSeq: map.frameSeq };
}

/** The mean over lenses of what terms make of their spacings; null where they do not tell that. */
function meanOf(
  lenses: Lens[],
  terms: (lens: Lens) => number[],
): Pick<RegionSpacing, "spacingPx" | "sigmaPx"> | null {
  const rows = lenses.map(terms);
  const found = fit(
    rows,
    lenses.map((lens) => lens.spacingPx),
    lenses.map((lens) => lens.sigmaPx),
  );
  if (!found) return null;
  const mean = found.of.map((_, term) => rows.reduce((sum, row) => sum + row[term]!, 0) / rows.length);
  const spread = found.covariance.map((line) => dot(line, mean));
  const variance = dot(mean, spread) * found.scatter * SHARED;
  return { spacingPx: dot(found.of, mean), sigmaPx: Math.sqrt(variance) };
}

/** The terms of a smooth surface over a region: its middle, along x, along y, with the distance squared. */
function smooth({ x, y, width, height }: Region): (lens: Lens) => number[] {
  const half = Math.max(width, height) / 2;
  return (lens) => {
    const [u, v] = [(lens.x - x - width / 2) / half, (lens.y - y - height / 2) / half];
    return [1, u, v, u * u + v * v];
  };
}

/** Grey levels of the picture, 0 to 255. */
export interface Grey {
  mean: number;
  least: number;
  most: number;
  /** Share of the pixels that are saturated. */
  saturated: number;
}

/** Of pixels, RGBA, one at least. */
export function greyOf(pixels: Uint8ClampedArray): Grey {
  let [sum, least, most] = [0, 255, 0];
  for (let at = 0; at < pixels.length; at += 4) {
    const level = pixels[at] ?? 0;
    sum += level;
    if (level < least) least = level;
    if (level > most) most = level;
  }
  const count = pixels.length / 4;
  return { mean: sum / count, least, most, saturated: saturated(pixels) / count };
}
