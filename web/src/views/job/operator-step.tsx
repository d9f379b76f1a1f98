import { useState } from "preact/hooks";
import * as api from "../../api";
import { keyWithin } from "../../confirm-key";
import { may } from "../../state";
import { strings } from "../../strings";
import { reworded } from "../../units";
import type { Job } from "../../wire";
import type { Scene } from "../scene";

/** What waits for the operator, with the number that matters large; confirmed by whoever has a key of the job. */
export function OperatorStep(scene: Scene & { job: Job }) {
  const { state, act, job } = scene;
  const { unit } = state.preferences;
  const step = job.operator_step;
  if (!step || job.state !== "waiting_for_operator") return null;
  return (
    <div class="operator" role="group" aria-live="polite" aria-label={strings.job.operator(step.number)}>
      <h3>{strings.job.operator(step.number)}</h3>
      {step.value && <p class="number">{reworded(step.value, unit)}</p>}
      <p>{reworded(step.instruction, unit)}</p>
      {mayConfirm(scene) ? (
        <button
          type="button"
          id="confirm"
          class="primary"
          onClick={() => void act(api.confirmStep(job, step.number))}
        >
          {strings.job.confirm}
        </button>
      ) : (
        <GiveKey {...scene} />
      )}
    </div>
  );
}

/** Whether this tab holds the lease that the job has, or the job's confirm key. */
function mayConfirm({ state, job }: Scene & { job: Job }): boolean {
  if (!may(state, "control")) return false;
  const held = state.bench?.lease ?? null;
  return api.confirmKeys.of(job.id) !== null || (held?.job === job.id && api.lease.isMine(held));
}

/** Why nothing can be confirmed here, and a place for the key. */
function GiveKey({ state, update, job }: Scene & { job: Job }) {
  const [text, setText] = useState("");
  const [wrong, setWrong] = useState(false);
  if (!may(state, "control")) return <p class="quiet">{strings.viewOnly}</p>;
  const submit = (event: Event) => {
    event.preventDefault();
    const key = keyWithin(text);
    setWrong(key === null);
    if (key === null) return;
    api.confirmKeys.keep({ job: job.id, key });
    update({ problem: null });
  };
  return (
    <form class="give-key" onSubmit={submit}>
      <p>{strings.job.noKey(job.owner ?? "")}</p>
      <label>
        {strings.job.confirmKey}{" "}
        <input
          id="confirm-key"
          type="password"
          autocomplete="off"
          required
          value={text}
          aria-invalid={wrong}
          onInput={(event) => setText(event.currentTarget.value)}
        />
      </label>
      <button type="submit">{strings.job.useKey}</button>
      {wrong && (
        <span class="fault" role="alert">
          {strings.job.noSuchKey}
        </span>
      )}
    </form>
  );
}
