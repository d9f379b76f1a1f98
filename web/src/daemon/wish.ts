// What the page wants to be sent.

import type { Route } from "../browser/route";
import type { Show } from "./wire";

/** What this page wants to see. It costs the daemon work: nothing is wished for while nobody looks. */
export interface Wish {
  /** What the meter reads, frame by frame, and whole measurements now and then: these check it. */
  readings: boolean;
  pictures: boolean;
  /** The spacing over the field, too. */
  overlay: boolean;
  /** What the pictures show. */
  show: Show;
}

export function sameWish(one: Wish, other: Wish): boolean {
  return (
    one.readings === other.readings &&
    one.pictures === other.pictures &&
    one.overlay === other.overlay &&
    one.show === other.show
  );
}

/** What is looked at: the picture, the meter without it, or neither. */
export function lookedAt(route: Route, visible: boolean): "picture" | "meter" | null {
  if (!visible) return null;
  if (route.page === "live") return "picture";
  const meter = route.page === "meter" || (route.page === "alignment" && route.jobs.length === 0);
  return meter ? "meter" : null;
}

/** What is wished for by who looks at a picture, or at the meter alone. */
export function wishOf(looking: ReturnType<typeof lookedAt>, picture: Pick<Wish, "overlay" | "show">): Wish {
  const readings = looking !== null;
  // No picture is made that nobody sees.
  if (looking === "picture") return { ...picture, readings, pictures: true };
  return { readings, pictures: false, overlay: false, show: "raw" };
}
