// What is said where there is no reading: why a frame has none, and that there has been none yet.

import type { Missing } from "./reading";
import { jobUnderWay, type State } from "./state";
import { strings } from "./strings";

/** Why in words, and whether they are the daemon's. */
export interface Why {
  text: string;
  daemons: boolean;
}

/** Why the newest frame has none. A board of several levels, or none, before the lens says more than what the frame shows. */
export function whyMissing(missing: Missing, { bench }: Pick<State, "bench">): Why {
  const words = strings.meter;
  if (missing.is === "lost" && bench?.in_view === "stepped_board")
    return { text: words.overSteps, daemons: false };
  if (missing.is === "lost" && bench?.in_view === "other") return { text: words.overNone, daemons: false };
  return { text: missing.why, daemons: true };
}

/** What stands where nothing has been read. */
export function nothingRead(state: Pick<State, "bench" | "jobs">): string {
  if (!state.bench) return strings.meter.unheard;
  return jobUnderWay(state) ? strings.meter.noneOfThis : strings.meter.none;
}
