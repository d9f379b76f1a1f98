// What the live picture shows: the raw frame, or what is made of it.

import type { Overlay } from "./preferences";
import type { Size } from "./viewport";
import type { PictureFacts, Show } from "./wire";

/** What may be chosen on the page. */
export const SHOWS = ["raw", "central", "depth"] as const satisfies readonly Show[];

const NONE: Overlay[] = [];

/** What can be drawn over it: overlays lie on raw pixels. */
export function overlaysOn(show: Show, overlays: Overlay[]): Overlay[] {
  return show === "raw" ? overlays : NONE;
}

/** The size that places in a picture count in: raw pixels of a raw frame however coarse it comes, else its own. */
export function extent(facts: Pick<PictureFacts, "show" | "widthPx" | "heightPx">, drawn: Size): Size {
  if (facts.show === "raw") return { width: facts.widthPx, height: facts.heightPx };
  return { width: drawn.width, height: drawn.height };
}
