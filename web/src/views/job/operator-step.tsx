import * as api from "../../api";
import { strings } from "../../strings";
import type { Job } from "../../wire";
import type { Act } from "../scene";

/** What waits for the operator, with the number that matters large. */
export function OperatorStep({ job, act }: { job: Job; act: Act }) {
  const step = job.operator_step;
  if (!step || job.state !== "waiting_for_operator") return null;
  return (
    <div class="operator" role="group" aria-live="polite" aria-label={strings.job.operator(step.number)}>
      <h3>{strings.job.operator(step.number)}</h3>
      {step.value && <p class="number">{step.value}</p>}
      <p>{step.instruction}</p>
      <button
        type="button"
        id="confirm"
        class="primary"
        onClick={() => void act(api.confirmStep(job, step.number))}
      >
        {strings.job.confirm}
      </button>
    </div>
  );
}
