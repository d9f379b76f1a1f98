import { useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { isDead, linkWith } from "../../daemon/confirm-key";
import { may } from "../../state";
import { strings } from "../../strings";
import type { Job } from "../../daemon/wire";
import type { Given } from "../given";

/** The link by which somebody else confirms what the job asks, for whoever has it or may make another. */
export function HandOn({ state, act, job }: Given & { job: Job }) {
  const [, renewed] = useState(0);
  const key = api.confirmKeys.of(job.id);
  const mine = api.lease.hasJob(state.bench?.lease ?? null, job.id);
  const mayRenew = may(state, "admin") || (mine && may(state, "control"));
  if (key === null && !mayRenew) return null;
  const dead = key !== null && isDead({ job: job.id, key }, state.bench);
  const renew = async () => {
    if (await act(api.renewConfirmKey(job))) renewed((times) => times + 1);
  };
  return (
    <details class="hand-on">
      <summary>{strings.job.handOn}</summary>
      <p class="quiet">{strings.job.handOnMore}</p>
      {dead && <p class="fault">{strings.job.linkDead}</p>}
      {key !== null && !dead && (
        <label>
          {strings.job.link}{" "}
          <input
            id="confirm-link"
            readOnly
            value={linkWith(`${location.origin}/`, { job: job.id, key })}
            onFocus={(event) => event.currentTarget.select()}
          />
        </label>
      )}
      {mayRenew && (
        <button type="button" id="renew-key" disabled={state.link !== "open"} onClick={() => void renew()}>
          {strings.job.renewKey}
        </button>
      )}
    </details>
  );
}
