// Stopping the bench: by button or by key, tried again where it does not get through.

import * as api from "../daemon/api";
import { jog } from "./jogging";
import { strings } from "../strings";
import type { State } from "../state";
import { focusedElement, meaning, type StopKey } from "./stop-key";
import type { Problem } from "../daemon/wire";

const TRIES = 3;
const REST_MS = 250;
/** A stop takes milliseconds: one that is not answered by then is said not to be, while it goes on being tried. */
const LATE_MS = 1000;

const unanswered = (): Problem => ({
  type: "about:blank",
  title: strings.noAnswer,
  status: 0,
  detail: strings.stop.tried,
});

/** Sends the stop until the daemon has it, or three times. */
export async function stop(update: (change: Partial<State>) => void, newest: () => State): Promise<void> {
  jog.release();
  const late = setTimeout(() => {
    // It has arrived where the bench is known to be stopped, although the answer has not.
    if (newest().link !== "open" || !newest().bench?.stop.latched) update({ stopFailed: unanswered() });
  }, LATE_MS);
  const result = await deliver(update);
  clearTimeout(late);
  if (!result.ok) return update({ stopFailed: result.problem });
  const { focus, e, kept } = result.value;
  return update({ stopFailed: null, stopSent: { focus, e, kept } });
}

async function deliver(update: (change: Partial<State>) => void): ReturnType<typeof api.stopAll> {
  let result = await api.stopAll();
  for (let tried = 1; tried < TRIES && !result.ok && result.problem.status === 0; tried += 1) {
    update({ stopFailed: result.problem });
    await new Promise((resolve) => setTimeout(resolve, REST_MS));
    result = await api.stopAll();
  }
  return result;
}

/** Has the stop key stop the bench, before anything else on the page sees it. */
export function watchStopKey(key: () => StopKey, enabled: () => boolean, obey: () => void): void {
  const hear = (event: KeyboardEvent) => {
    if (!enabled()) return;
    const means = meaning(event, focusedElement(), key());
    if (means === "pass") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (means === "stop") obey();
  };
  window.addEventListener("keydown", hear, { capture: true });
  window.addEventListener("keyup", hear, { capture: true });
}
