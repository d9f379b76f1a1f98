// What the live picture shows: the raw frame, or what is made of it.

import type { Overlay } from "../preferences";
import { isOfOne, type Reading } from "../meter/reading";
import type { Size } from "./viewport";
import type { PictureFacts, Show } from "../daemon/wire";

/** What may be chosen on the page. */
export const SHOWS = ["raw", "central", "depth"] as const satisfies readonly Show[];

const NONE: Overlay[] = [];

/** What can be drawn over it: overlays lie on raw pixels. */
export function overlaysOn(show: Show, overlays: Overlay[]): Overlay[] {
  return show === "raw" ? overlays : NONE;
}

/** What of it can be drawn of a reading: the error of a spacing that is no one board's is of nothing. Unchanged where all can. */
export function drawable(overlays: Overlay[], reading: Pick<Reading, "direction"> | null): Overlay[] {
  if (!reading || isOfOne(reading) || !overlays.includes("error")) return overlays;
  return overlays.filter((overlay) => overlay !== "error");
}

/** The size that places in a picture count in: raw pixels of a raw frame however coarse it comes, else its own. */
export function extent(facts: Pick<PictureFacts, "show" | "widthPx" | "heightPx">, drawn: Size): Size {
  if (facts.show === "raw") return { width: facts.widthPx, height: facts.heightPx };
  return { width: drawn.width, height: drawn.height };
}
