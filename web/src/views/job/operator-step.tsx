import * as api from "../../api";
import { strings } from "../../strings";
import { reworded, type LengthUnit } from "../../units";
import type { Job } from "../../wire";
import type { Act } from "../scene";

/** What waits for the operator, with the number that matters large. */
export function OperatorStep({ job, act, unit }: { job: Job; act: Act; unit: LengthUnit }) {
  const step = job.operator_step;
  if (!step || job.state !== "waiting_for_operator") return null;
  return (
    <div class="operator" role="group" aria-live="polite" aria-label={strings.job.operator(step.number)}>
      <h3>{strings.job.operator(step.number)}</h3>
      {step.value && <p class="number">{reworded(step.value, unit)}</p>}
      <p>{reworded(step.instruction, unit)}</p>
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
