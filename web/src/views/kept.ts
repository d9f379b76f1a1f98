import { useState } from "preact/hooks";
import type { State } from "../state";
import type { Given } from "./given";

/**
 * A part of the page's state that a view edits, and what sets it. It is drawn at once with each key, while the page as a whole
 * follows a little later, and is there when the view is come back to.
 */
export function useKept<Part extends keyof State>({ newest, update }: Given, part: Part) {
  const [, draw] = useState({});
  const keep = (value: State[Part]) => {
    update({ [part]: value } as Pick<State, Part>);
    draw({});
  };
  return [newest()[part], keep] as const;
}
