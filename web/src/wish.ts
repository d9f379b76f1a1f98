// What the page wants to be sent.

import type { Route } from "./route";
import type { Show } from "./wire";

/** As quickly as a screen is worth. */
const LIVE_HZ = 30;
/** The meter alone needs few and coarse pictures: while there are some, the daemon measures in whole. That checks what is
 *  followed from frame to frame, and is all that there is before a reading. */
const METER_HZ = 1;

/** What this page wants to see. It costs the daemon work: nothing is wished for while nobody looks. */
export interface Wish {
  /** What the meter reads, frame by frame. */
  readings: boolean;
  pictures: boolean;
  /** So many a second at most. */
  rateHz: number;
  /** The spacing over the field, too. */
  overlay: boolean;
  /** What the pictures show. */
  show: Show;
}

export function sameWish(one: Wish, other: Wish): boolean {
  return (
    one.readings === other.readings &&
    one.pictures === other.pictures &&
    one.rateHz === other.rateHz &&
    one.overlay === other.overlay &&
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
export function wishOf(looking: ReturnType<typeof lookedAt>, picture: Pick<Wish, "overlay" | "show">): Wish {
  const looks = looking !== null;
  if (looking === "picture") return { ...picture, readings: looks, pictures: looks, rateHz: LIVE_HZ };
  return { readings: looks, pictures: looks, rateHz: METER_HZ, overlay: false, show: "raw" };
}
