// How a histogram is drawn: a step for each range of grey levels, as high as the logarithm of its pixels.

import type { Histogram } from "../daemon/wire";

/** SVG paths within 0 to 1, to the right and downwards. */
export interface Drawn {
  /** What is at black, and can be no darker. */
  black: string;
  between: string;
  /** What is clipped at white: one step, however it is spread over the last levels. */
  white: string;
}

type Counted = Pick<Histogram, "counts" | "bits" | "levels_per_range" | "clipped_from">;

export function drawn({ counts, bits, levels_per_range: width, clipped_from }: Counted): Drawn {
  const levels = 2 ** bits;
  const first = Math.min(counts.length, Math.ceil(clipped_from / width));
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
