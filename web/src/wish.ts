// What the page wants to be sent.

import type { Show } from "./wire";

/** What this page wants to see. Pictures cost the daemon work: none are wished for while nobody looks. */
export interface Wish {
  pictures: boolean;
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
    one.overlay === other.overlay &&
    one.reduce === other.reduce &&
    one.show === other.show
  );
}
