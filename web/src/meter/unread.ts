// What is said where there is no reading: why a frame has none, and that there has been none yet.

import type { Missing } from "./reading";
import { jobUnderWay, type State } from "../state";
import { strings } from "../strings";

export interface Why {
  /** What is the matter. */
  what: string;
  /** Why, and whether these are the daemon's words. */
  text: string;
  daemons: boolean;
  /** Whether there may be a spacing, which is looked for. */
  sought: boolean;
  /** What the daemon says besides, which may be the cause. */
  besides: string | null;
}

/** Why the newest frame has none. A board of several levels, or none, before the lens says more than what the frame shows. */
export function whyMissing(missing: Missing, { bench }: Pick<State, "bench">): Why {
  const words = strings.meter;
  const lost = missing.is === "lost";
  const what = words.missing[missing.is];
  if (lost && bench?.in_view === "stepped_board")
    return { what, text: words.overSteps, daemons: false, sought: true, besides: missing.why };
  if (lost && bench?.in_view === "other")
    return {
      what: words.missing.refused,
      text: words.overNone,
      daemons: false,
      sought: false,
      besides: null,
    };
  return { what, text: missing.why, daemons: true, sought: lost, besides: null };
}

/** What stands where nothing has been read: that there is nothing, why, and whether an alignment would change that. */
export function nothingRead(state: Pick<State, "bench" | "jobs">): {
  what: string;
  why: string | null;
  begins: boolean;
} {
  const words = strings.meter;
  const { bench } = state;
  if (!bench) return { what: words.unheard, why: null, begins: false };
  const { unfit } = bench.camera;
  if (unfit) return { what: words.none, why: strings.byHand.cameraUnfit(unfit), begins: false };
  if (jobUnderWay(state)) return { what: words.noneOfThis, why: null, begins: false };
  return { what: words.none, why: words.noneMore, begins: true };
}
