// How a histogram is drawn: a step for each range of grey levels, as high as the logarithm of its pixels.

import type { Histogram } from "./wire";

/** Within this part of the greatest level a pixel is clipped, as the daemon counts them. */
const CLIPPED_WITHIN = 1 / 50;
/** More clipped pixels than that are a fault of the exposure: fewer are hot pixels and mirrored lamps. */
export const CLIPPED_SHARE = 0.002;

/** SVG paths within 0 to 1, to the right and downwards. */
export interface Drawn {
  /** What is at black, and can be no darker. */
  black: string;
  between: string;
  /** What is clipped at white: one step, however it is spread over the last levels. */
  white: string;
}

export function drawn(of: Pick<Histogram, "counts" | "bits" | "levels_per_range">): Drawn {
  const { counts, bits, levels_per_range: width } = of;
  const levels = 2 ** bits;
  const first = Math.min(
    counts.length,
    Math.ceil((levels - 1 - Math.floor((levels - 1) * CLIPPED_WITHIN)) / width),
  );
  const clipped = counts.slice(first).reduce((sum, count) => sum + count, 0);
  const highest = Math.log1p(Math.max(1, clipped, ...counts));
  const step = (count: number, from: number, to: number) =>
    count === 0
      ? ""
      : `M${place((from * width) / levels)} 1V${place(1 - Math.log1p(count) / highest)}H${place(Math.min(1, (to * width) / levels))}V1Z`;
  const [black = "", ...between] = counts.slice(0, first).map((count, at) => step(count, at, at + 1));
  return { black, between: between.join(""), white: step(clipped, first, counts.length) };
}

const place = (part: number) => String(Number(part.toFixed(4)));
