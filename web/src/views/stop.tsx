import * as api from "../api";
import { stop } from "../stopping";
import { may } from "../state";
import { clock } from "../format";
import { strings } from "../strings";
import type { Scene } from "./scene";

/** STOP, on every page, for everybody. */
export function Stop({ state, update }: Scene) {
  const key = state.preferences.stopKey.name;
  return (
    <button type="button" id="stop" title={strings.stop.more(key)} onClick={() => void stop(update)}>
      {strings.stop.stop} <small>{strings.stop.key(key)}</small>
    </button>
  );
}

/** That the bench is stopped, or that it could not be. */
export function StopNotices({ state, update, act }: Scene) {
  const since = state.bench?.stop.since;
  return (
    <>
      {state.stopFailed && (
        <div class="stop-failed" role="alert">
          <p>
            <b>{strings.stop.failed}.</b> {strings.stop.failedMore} {state.stopFailed.title}:{" "}
            {state.stopFailed.detail}
          </p>
          <button type="button" onClick={() => void stop(update)}>
            {strings.stop.again}
          </button>
          <button type="button" onClick={() => update({ stopFailed: null })}>
            {strings.dismiss}
          </button>
        </div>
      )}
      {state.bench?.stop.latched && (
        <div class="stopped" role="alert">
          <p>
            <b>{since ? strings.stop.stoppedSince(clock(since)) : strings.stop.stopped}.</b>{" "}
            {state.stopSent &&
              strings.stop.sent(
                strings.stop.delivery[state.stopSent.focus],
                strings.stop.delivery[state.stopSent.e],
              )}{" "}
            {strings.stop.stoppedMore}
          </p>
          <button
            type="button"
            id="reset"
            disabled={!may(state, "control")}
            onClick={() => void act(api.resetStop())}
          >
            {strings.stop.reset}
          </button>
        </div>
      )}
    </>
  );
}
