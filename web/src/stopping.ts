// Stopping the bench: by button or by key, tried again where it does not get through.

import * as api from "./api";
import { jog } from "./jogging";
import type { State } from "./state";
import { meaning, type StopKey } from "./stop-key";

const TRIES = 3;
const REST_MS = 250;

/** Sends the stop until the daemon has it, or three times. */
export async function stop(update: (change: Partial<State>) => void): Promise<void> {
  jog.release();
  let result = await api.stopAll();
  for (let tried = 1; tried < TRIES && !result.ok && result.problem.status === 0; tried += 1) {
    update({ stopFailed: result.problem });
    await new Promise((resolve) => setTimeout(resolve, REST_MS));
    result = await api.stopAll();
  }
  if (!result.ok) return update({ stopFailed: result.problem });
  const { focus, e, kept } = result.value;
  return update({ stopFailed: null, stopSent: { focus, e, kept } });
}

/** Has the stop key stop the bench, before anything else on the page sees it. */
export function watchStopKey(key: () => StopKey, enabled: () => boolean, obey: () => void): void {
  const hear = (event: KeyboardEvent) => {
    if (!enabled()) return;
    const focused = document.activeElement instanceof HTMLElement ? document.activeElement : null;
    const means = meaning(event, focused as HTMLInputElement | null, key());
    if (means === "pass") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (means === "stop") obey();
  };
  window.addEventListener("keydown", hear, { capture: true });
  window.addEventListener("keyup", hear, { capture: true });
}
