import * as api from "../../daemon/api";
import { eyepiece } from "../../picture/eyepiece";
import { nameOf, save } from "../../picture/kept-picture";
import { strings } from "../../strings";
import type { Given } from "../given";
import { Toggle } from "../toggle";
import { depthEnds } from "./depth-ends";

interface Props extends Given {
  large: boolean;
  enlarge: (large: boolean) => void;
}

/** What is kept of the picture, and the picture alone. */
export function Keeping({ state, act, update, large, enlarge }: Props) {
  const words = strings.measuring;
  const snapshot = async () => {
    const taken = await eyepiece.snapshot({
      simulated: strings.simulated,
      replayed: strings.replay,
      depth: { ...depthEnds(state), unknown: strings.picture.legendUnknown },
    });
    if (taken) return save(taken.file, nameOf({ ...taken.facts, kind: "view" }));
    return update({ problem: { type: "about:blank", title: words.nothing, status: 0, detail: "" } });
  };
  const raw = async () => {
    const asked = api.rawFrame();
    if (!(await act(asked))) return;
    const got = await asked;
    if (got.ok) save(got.value.file, nameOf(got.value.about));
  };
  return (
    <span class="choice" role="group" aria-label={words.keep}>
      <button
        type="button"
        title={words.snapshotMore}
        disabled={!state.picture}
        onClick={() => void snapshot()}
      >
        {words.snapshot}
      </button>
      <button type="button" title={words.rawMore} disabled={state.link !== "open"} onClick={() => void raw()}>
        {words.raw}
      </button>
      <Toggle id="enlarge" on={large} set={enlarge} title={words.fullMore}>
        {words.full}
      </Toggle>
    </span>
  );
}
