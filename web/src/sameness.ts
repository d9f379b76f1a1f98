// Whether the camera gives an old picture again as if it were new: no sensor takes the same one twice, to the last byte.

import type { PictureFacts } from "./wire";

/** So many in a row are no chance. */
export const SAME = 3;

export class Sameness {
  private last: { seq: number; bytes: Uint8Array } | null = null;
  private count = 1;

  /** How many pictures in a row are the same, up to this one, of as many frames; 1 where it is another than the one before. What
   *  is played from files may well come again. */
  note(bytes: Uint8Array, { seq, replayed }: Pick<PictureFacts, "seq" | "replayed">): number {
    const before = this.last;
    this.last = { seq, bytes };
    if (before === null || replayed || !same(before.bytes, bytes)) this.count = 1;
    else if (seq !== before.seq) this.count += 1;
    return this.count;
  }
}

function same(one: Uint8Array, other: Uint8Array): boolean {
  return one.length === other.length && one.every((byte, at) => byte === other[at]);
}
