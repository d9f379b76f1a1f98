// Which stretch of time the charts show: pure, so that zooming can be tested.

import { SPAN_S } from "./trail";

/** This page's clock, s. */
export interface Stretch {
  from: number;
  to: number;
}

/** The newest minutes, or all there is, both as time goes on; or a stretch that stands still. */
export type Looked = "recent" | "whole" | Stretch;

/** What two lengths may differ by and be the same, s. */
const SAME_S = 0.01;
/** No shorter one says anything, s. */
export const SHORTEST_S = 2;

/** All that can be looked at: since `oldest`, the earliest time that there is something of. */
export function allOf(oldest: number | null, now: number): Stretch {
  return { from: Math.min(oldest ?? now, now - SPAN_S), to: now };
}

export function stretchOf(looked: Looked, all: Stretch): Stretch {
  if (looked === "whole") return all;
  return looked === "recent" ? { from: all.to - SPAN_S, to: all.to } : looked;
}

/** Longer by `factor` about a time that stays where it is; all of it where it would be longer. */
export function zoomed({ from, to }: Stretch, factor: number, about: number, all: Stretch): Looked {
  const long = Math.max(SHORTEST_S, (to - from) * factor);
  if (long >= all.to - all.from) return "whole";
  const start = about - ((about - from) / (to - from)) * long;
  return within({ from: start, to: start + long }, all);
}

/** Later by so many seconds. Two minutes that end now go on with time, and so does all there is. */
export function moved({ from, to }: Stretch, byS: number, all: Stretch): Looked {
  const there = within({ from: from + byS, to: to + byS }, all);
  if (there.to < all.to) return there;
  if (Math.abs(there.to - there.from - SPAN_S) < SAME_S) return "recent";
  return there.from <= all.from ? "whole" : there;
}

function within({ from, to }: Stretch, all: Stretch): Stretch {
  const by = Math.max(all.from - from, 0) + Math.min(all.to - to, 0);
  return { from: from + by, to: to + by };
}

/** Between two ticks, s: what a clock is divided into. */
export const TICKS_S = [
  0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 21600, 43200, 86400,
];
