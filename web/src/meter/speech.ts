// When a reading of the meter is worth being said aloud again: a screen reader is to be listened to, not to be drowned in
// figures that differ in their last digit.

import { isOfOne, type Reading } from "./reading";

/** Between two things said, ms at least. */
export const SPEAK_MS = 5000;
/** A difference from the target that has changed by less than this share of what was said is no news. */
const SHARE = 0.1;
/** Nor is one that has changed by less than this many of its standard uncertainties. */
const SIGMAS = 3;

/** What was said last, and when, ms. */
export interface Said {
  text: string;
  differencePx: number;
  /** Null: that it is lost. */
  direction: Reading["direction"] | null;
  at: number;
}

/** Words without their figures: what they tell somebody to do, or not to. */
function sense(text: string): string {
  return text.replace(/[+−]?\d[\d.]*/g, "");
}

/** Whether what the meter says of a reading, or of none where it is lost, is to be said after what was said last. */
export function isNews(
  said: Said | null,
  reading: Pick<Reading, "differencePx" | "sigmaPx" | "direction"> | null,
  text: string,
  now: number,
): boolean {
  if (said === null) return true;
  // What was said last would be an order to move by a spacing that is not known any more, or is of no one board.
  if (reading === null || !isOfOne(reading)) return said.direction !== (reading?.direction ?? null);
  if (now - said.at < SPEAK_MS) return false;
  if (reading.direction !== said.direction || sense(text) !== sense(said.text)) return true;
  // On the target it stays on the target.
  if (["there", "unsure"].includes(reading.direction)) return false;
  const changed = Math.abs(reading.differencePx - said.differencePx);
  return changed > Math.max(SIGMAS * reading.sigmaPx, SHARE * Math.abs(said.differencePx));
}

/** What stands to be said: nothing any more once it has been, so that nobody comes upon it when the meter has gone on. */
export function standing(said: Said | null, now: number): string {
  return said && now - said.at < SPEAK_MS ? said.text : "";
}
