// What the meter says now, however large it is drawn.

import { useEffect, useState } from "preact/hooks";
import { advice, type Advice, type Moved } from "../../meter/advice";
import { hindrance } from "../../meter/hindrance";
import { correction } from "../../meter/correction";
import { signed } from "../../words/format";
import { steadyDigits } from "../../meter/scale";
import { needle } from "../../meter/needle";
import { pageNow } from "../../browser/page-clock";
import { isCalledInFocus, isOfOne, type Direction, type Missing, type Reading } from "../../meter/reading";
import { isMeterOld, jobUnderWay, meterAge, type State } from "../../state";
import { strings } from "../../strings";
import { whyMissing, type Why } from "../../meter/unread";
import type { Given } from "../given";

export const ARROW = {
  larger: "▲",
  smaller: "▼",
  there: "✓",
  unsure: "≈",
  two_boards: "≠",
  doubted: "≠",
  levels: "≠",
  elsewhere: "≠",
  unasked: "?",
  unsaid: "?",
} as const;
/** What stands where a figure would. */
export const NO_FIGURE = "–";

/** The large figure, or what stands in its place, as a screen reader reads it to whoever goes there. */
export function readAloud(large: string): string {
  if (large === strings.meter.lost) return large;
  return large === NO_FIGURE ? strings.meter.noFigure : strings.meter.pixels(large);
}

/** Words that stand before others, with the mark that ends them. */
export function sentence(words: string): string {
  return /[?:]$/.test(words) ? words : `${words}.`;
}

export interface Shown {
  /** Null where there is none now. */
  reading: Reading | null;
  /** Why there is none of the newest frame. */
  missing: Missing | null;
  why: Why | null;
  old: boolean;
  ageMs: number | null;
  /** The spacing of one board less its target, or what stands in its place. */
  figure: string;
  /** What it is, in words. */
  words: string | null;
  /** Whether it is called in focus. */
  inFocus: boolean;
  /** What is to be done about it. */
  wanted: Advice | null;
}

/** Whether Δv is set by hand, or e. */
function movedNow({ bench }: State): Moved {
  return bench?.shell === "off" ? "delta_v" : "e";
}

/** What a reading calls for: nothing beside a job, which moves what it has to, nor where it may no longer be so. */
function order(state: State, reading: Reading, old: boolean): Advice {
  if (jobUnderWay(state)) return { main: strings.meter.job, other: null };
  if (old) return { main: strings.meter.oldMore, other: null };
  const { unit } = state.preferences;
  const { bench } = state;
  return advice(reading, correction(state.design, reading), movedNow(state), unit, (moved, byMm) =>
    hindrance(bench, moved, byMm),
  );
}

function inWords({ direction, inFocus }: Reading): string {
  const nearly: Partial<Record<Direction, string>> = inFocus ? strings.meter.nearly : {};
  return nearly[direction] ?? strings.meter.words[direction];
}

/** The state as it is at the newest reading: what uses it is drawn with the page, and by itself with each reading. */
export function useNewest(given: Given): Given {
  const [, draw] = useState({});
  useEffect(() => needle.follow(() => draw({})), []);
  return { ...given, state: given.newest(), now: pageNow() };
}

/** What the meter says; a figure keeps its number of decimals while its uncertainty only just calls for others. */
export function useShown({ state, now }: Given): Shown {
  const [held] = useState<{ places: number | null }>({ places: null });
  const { missing } = state;
  // What was read before it was lost is no reading of what there is now.
  const reading = missing?.is === "lost" ? null : state.reading;
  if (reading) held.places = steadyDigits(reading.sigmaPx, held.places);
  const old = isMeterOld(state, now);
  const why = missing && whyMissing(missing, state);
  const difference = reading && isOfOne(reading) ? signed(reading.differencePx, held.places ?? 0) : NO_FIGURE;
  return {
    reading,
    missing,
    why,
    old,
    ageMs: meterAge(state, now),
    figure: why?.sought ? strings.meter.lost : difference,
    words: reading && inWords(reading),
    inFocus: reading !== null && !old && isCalledInFocus(reading),
    wanted: reading && order(state, reading, old),
  };
}
