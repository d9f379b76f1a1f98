import { useEffect, useRef, useState } from "preact/hooks";
import { isFocusLost } from "../browser/focus";
import * as api from "../daemon/api";
import { clock } from "../words/format";
import { called } from "../words/names";
import { able, may, newsOfReset } from "../state";
import { SPACE, type StopKey } from "../bench/stop-key";
import { stop } from "../bench/stopping";
import { strings } from "../strings";
import type { Bench } from "../daemon/wire";
import type { Given } from "./given";
import { useSettled } from "./settled";

/** What a key is called. */
export function nameOfKey({ code, name }: StopKey): string {
  return code === SPACE.code ? strings.stop.space : name;
}

/** STOP, on every page, for everybody. */
export function Stop({ state, update, newest }: Given) {
  const key = nameOfKey(state.preferences.stopKey);
  return (
    <button type="button" id="stop" title={strings.stop.more(key)} onClick={() => void stop(update, newest)}>
      {strings.stop.stop} <small>{strings.stop.key(key)}</small>
    </button>
  );
}

/** That the bench is stopped, or that it could not be, and who reset it last. */
export function StopNotices(given: Given) {
  const { state, update, newest, now } = given;
  useFocusKept(state.bench?.stop.latched ?? false);
  // What may have changed since is no news.
  const reset = state.link === "open" ? newsOfReset(state, now) : null;
  return (
    <>
      {state.stopFailed && (
        <div class="stop-failed" role="alert">
          <p>
            <b>{strings.stop.failed}.</b> {strings.stop.failedMore} {state.stopFailed.title}:{" "}
            {state.stopFailed.detail}
          </p>
          <button type="button" onClick={() => void stop(update, newest)}>
            {strings.stop.again}
          </button>
          <button type="button" onClick={() => update({ stopFailed: null })}>
            {strings.dismiss}
          </button>
        </div>
      )}
      {state.notStopped && (
        <div class="problem" role="alert" id="not-stopped">
          <p>
            <b>{strings.stop.notStopped}.</b> {strings.stop.notStoppedMore}
          </p>
          <button type="button" onClick={() => update({ notStopped: false })}>
            {strings.dismiss}
          </button>
        </div>
      )}
      {state.bench?.stop.latched && <Stopped {...given} stop={state.bench.stop} />}
      {reset && (
        <div class="was-reset" role="alert">
          <p>
            <b>{strings.stop.wasReset(called(reset.by, "first"), clock(reset.at))}:</b> {reset.why}
            {reset.stopped_at &&
              ` (${strings.stop.hadStopped(called(reset.stopped_by ?? ""), clock(reset.stopped_at))})`}
          </p>
          <button type="button" onClick={() => update({ resetSeen: reset.at })}>
            {strings.dismiss}
          </button>
        </div>
      )}
    </>
  );
}

/** A stop takes the focus from what is dead until the reset, and the reset from the question why. Whoever is at the keyboard is
 *  led to the one, and then back. */
function useFocusKept(latched: boolean) {
  const [held] = useState<{ latched: boolean; at: Element | null }>({ latched: false, at: null });
  // Before what is drawn now takes it.
  if (latched && !held.latched) held.at = document.activeElement;
  held.latched = latched;
  useEffect(() => {
    const lost = isFocusLost();
    // What is not dead keeps it.
    if (latched && (!lost || held.at === document.body)) held.at = null;
    if (!lost || !(held.at instanceof HTMLElement)) return;
    (latched ? document.getElementById("reset") : held.at)?.focus({ preventScroll: true });
  }, [latched]);
}

/** Since when the bench is stopped and by whom; and the question why it may move again. */
function Stopped({ state, act, update, stop }: Given & { stop: Bench["stop"] }) {
  const [asking, ask] = useState(false);
  const [why, setWhy] = useState("");
  const { since, by, unread } = stop;
  const sent = stop.delivery ?? state.stopSent;
  const settled = useSettled(asking ? "asking" : null);
  const reason = useRef<HTMLInputElement>(null);
  const [held] = useState({ asking });
  useEffect(() => {
    if (asking) reason.current?.focus();
    else if (held.asking) document.getElementById("reset")?.focus({ preventScroll: true });
    held.asking = asking;
  }, [asking]);
  const stay = () => settled && ask(false);
  const submit = async (event: Event) => {
    event.preventDefault();
    const asked = api.resetStop(why.trim());
    if (await act(asked)) {
      const answer = await asked;
      // Whoever has reset it needs no telling.
      if (answer.ok) update({ resetSeen: answer.value.reset?.at ?? null });
      ask(false);
    }
  };
  return (
    <div class="stopped" role="alert">
      <p>
        <b>{since ? strings.stop.stoppedSince(clock(since), called(by ?? "")) : strings.stop.stopped}.</b>{" "}
        {unread && `${strings.stop.unread(unread)} `}
        {sent && strings.stop.sent(strings.stop.delivery[sent.focus], strings.stop.delivery[sent.e])}{" "}
        {state.stopSent && !state.stopSent.kept && `${strings.stop.notKept} `}
        {strings.stop.stoppedMore} {state.session !== null && !may(state, "control") && strings.viewOnly}
      </p>
      {asking ? (
        <form
          class="why"
          aria-label={strings.stop.reset}
          onSubmit={(event) => void submit(event)}
          onKeyDown={({ key }) => key === "Escape" && stay()}
        >
          <label>
            {strings.stop.why}{" "}
            <input
              ref={reason}
              id="why"
              required
              maxLength={200}
              value={why}
              placeholder={strings.stop.whyMore}
              onInput={(event) => setWhy(event.currentTarget.value)}
            />
          </label>
          <button type="submit" id="reset-now" disabled={why.trim() === "" || !able(state, "control")}>
            {strings.stop.reset}
          </button>
          <button type="button" aria-disabled={!settled} onClick={stay}>
            {strings.stop.stay}
          </button>
        </form>
      ) : (
        <button type="button" id="reset" disabled={!able(state, "control")} onClick={() => ask(true)}>
          {strings.stop.resetAsk}
        </button>
      )}
    </div>
  );
}
