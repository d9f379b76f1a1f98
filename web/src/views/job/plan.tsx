import { useEffect, useState } from "preact/hooks";
import * as api from "../../api";
import { strings } from "../../strings";
import { length, pixels, reworded, type LengthUnit } from "../../units";
import type { Plan } from "../../wire";
import { SetUpDrawing } from "./set-up";
import { Explained } from "../term";

/** What an alignment would do, and what stands in its way; null until the daemon has said it. */
export function usePlan(wanted: boolean): Plan | null {
  const [plan, setPlan] = useState<Plan | null>(null);
  useEffect(() => {
    if (!wanted) return undefined;
    let still = true;
    void api.plan().then((result) => {
      if (still && result.ok) setPlan(result.value);
    });
    return () => {
      still = false;
    };
  }, [wanted]);
  return wanted ? plan : null;
}

/** Where it measures, what the operator will be asked, and how good it is expected to be; or why it cannot be done. */
export function PlanSummary({ plan, unit }: { plan: Plan; unit: LengthUnit }) {
  if (!plan.possible) {
    return (
      <div class="fault" role="alert" id="plan">
        <p>{strings.plan.impossible}</p>
        <ul>
          {plan.obstacles.map((obstacle) => (
            <li key={obstacle.key}>
              <code>{obstacle.key}</code>{" "}
              {strings.plan.obstacle(obstacle.value, obstacle.needed, obstacle.why)}
            </li>
          ))}
        </ul>
      </div>
    );
  }
  return (
    <details id="plan">
      <summary>{strings.plan.summary(plan.operator_steps.length, plan.duration_s)}</summary>
      <ol class="plan-steps">
        {plan.operator_steps.map((step, index) => (
          <li key={index}>
            {strings.steps.name(step.name)}
            {step.value === null || step.value === undefined ? "" : `: ${reworded(step.value, unit)}`}
            <SetUpDrawing setup={step.setup} unit={unit} small />
          </li>
        ))}
      </ol>
      <p>
        <Explained
          text={strings.plan.mounted(length(plan.mount_e_mm, unit, 1), pixels(plan.mount_spacing_px, 2))}
        />
      </p>
      <p>
        {strings.plan.expected(
          pixels(plan.spacing_sigma_px, 4),
          length(plan.delta_v_sigma_mm, unit, 4),
          length(plan.e_sigma_mm, unit, 3),
        )}{" "}
        <span class="quiet">{plan.assumed}</span>
      </p>
    </details>
  );
}
