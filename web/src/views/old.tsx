import { lateness } from "../daemon/clock";
import { span } from "../words/format";
import { strings } from "../strings";
import type { Given } from "./given";

/** Later than this, what comes over a line that is too slow is old, ms. */
const LATE_MS = 3000;

/** That what a card shows may no longer be so: the daemon has not been heard of for so long, or what it says comes so late. */
export function Old({ state, now }: Given) {
  const lateMs = lateness(state.clock);
  const lost = state.link === "lost" && state.heardAt !== null ? now - state.heardAt : null;
  const oldMs = lost ?? (state.link === "open" && lateMs > LATE_MS ? lateMs : null);
  return oldMs === null ? null : <span class="tag old">{strings.old(span(oldMs))}</span>;
}
