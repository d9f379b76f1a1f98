// What a part of the picture says for itself: its spacing, and how bright it is. Pure, so that it can be tested.

import type { Region } from "./marks";
import { saturated } from "./saturation";
import type { FieldMap } from "./wire";

/** Fewer micro-images say nothing of how far they scatter. */
const LEAST = 4;

export interface RegionSpacing {
  /** Mean over the micro-images whose centres are within. */
  spacingPx: number;
  /** Its standard uncertainty: noise and scatter. What the whole frame has in common is not in it. */
  sigmaPx: number;
  targetPx: number;
  lenses: number;
  /** The frame that was measured. */
  frameSeq: number;
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
  let [weights, sum] = [0, 0];
  for (const { spacingPx, sigmaPx } of within) {
    weights += sigmaPx ** -2;
    sum += spacingPx * sigmaPx ** -2;
  }
  const spacingPx = sum / weights;
  const scatter = within.reduce((all, lens) => all + ((lens.spacingPx - spacingPx) / lens.sigmaPx) ** 2, 0);
  const excess = Math.max(1, scatter / (within.length - 1));
  // Each pair of neighbours counts in both of them: so many micro-images say what half as many would.
  const sigmaPx = Math.sqrt((2 * excess) / weights);
  return { spacingPx, sigmaPx, targetPx: map.targetPx, lenses: within.length, frameSeq: map.frameSeq };
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
