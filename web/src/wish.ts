// What the page wants to be sent.

import type { Route } from "./route";
import type { Show } from "./wire";

/** As quickly as a screen is worth. */
const LIVE_HZ = 30;
/** The daemon measures while somebody looks: few and coarse pictures say that somebody does. */
const METER_HZ = 1;

/** What this page wants to see. Pictures cost the daemon work: none are wished for while nobody looks. */
export interface Wish {
  pictures: boolean;
  /** So many a second at most. */
  rateHz: number;
  /** The spacing over the field, too. */
  overlay: boolean;
  /** Raw pixels to a picture pixel, each way. */
  reduce: 1 | 2 | 4;
  /** What the pictures show. */
  show: Show;
}

export function sameWish(one: Wish, other: Wish): boolean {
  return (
    one.pictures === other.pictures &&
    one.rateHz === other.rateHz &&
    one.overlay === other.overlay &&
    one.reduce === other.reduce &&
    one.show === other.show
  );
}

/** What is looked at: the picture, the meter without it, or neither. */
export function lookedAt(route: Route, visible: boolean): "picture" | "meter" | null {
  if (!visible) return null;
  if (route.page === "live") return "picture";
  return route.page === "alignment" && route.jobs.length === 0 ? "meter" : null;
}

/** What is wished for by who looks at a picture, or at the meter alone. */
export function wishOf(
  looking: ReturnType<typeof lookedAt>,
  picture: Pick<Wish, "overlay" | "reduce" | "show">,
): Wish {
  if (looking === "picture") return { ...picture, pictures: true, rateHz: LIVE_HZ };
  return { pictures: looking === "meter", rateHz: METER_HZ, overlay: false, reduce: 4, show: "raw" };
}
