import { span } from "../format";
import { strings } from "../strings";
import type { Scene } from "./scene";

/** That what a card shows may no longer be so: the daemon has not been heard of for so long. */
export function Old({ state, now }: Scene) {
  if (state.link !== "lost" || state.heardAt === null) return null;
  return <span class="tag old">{strings.old(span(now - state.heardAt))}</span>;
}
