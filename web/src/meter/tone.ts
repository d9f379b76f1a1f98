// What the ear is told of the spacing, while hands and eyes are at the lens.

import { place } from "./scale";
import { isOfOne, type Reading } from "./reading";
import { isMeterOld, jobUnderWay, type State } from "../state";

export interface Tone {
  /** Higher than in the middle where the spacing is too large, lower where it is too small. */
  hertz: number;
  /** Pulses a second, more of them the nearer it is; null for a steady tone, where a job would accept it. */
  pulses: number | null;
}

/** The pitch in the middle of the meter's scale: an octave above and below it are the scale's ends. */
const MIDDLE_HZ = 440;
/** Pulses a second at the ends of the scale, and next to the middle. */
const PULSES = [2, 12] as const;

/** The tone for a reading. */
export function toneOf(reading: Pick<Reading, "differencePx" | "direction">): Tone {
  const off = place(reading.differencePx);
  const [far, near] = PULSES;
  const pulses = reading.direction === "there" ? null : near + (far - near) * Math.abs(off);
  return { hertz: MIDDLE_HZ * 2 ** off, pulses };
}

/** The tone for what the meter shows; none where that is nothing to go by, or not of one board, or where a job moves. */
export function toneNow(state: State, now: number): Tone | null {
  const { tone, reading, missing } = state;
  if (!tone || !reading || missing?.is === "lost" || jobUnderWay(state) || isMeterOld(state, now))
    return null;
  return isOfOne(reading) ? toneOf(reading) : null;
}
