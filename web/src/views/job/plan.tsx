import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import type { State } from "../../state";
import { strings } from "../../strings";
import { length, pixels, reworded, type LengthUnit } from "../../words/units";
import type { JobKind, Plan } from "../../daemon/wire";
import { SetUpDrawing } from "./set-up";
import { Explained } from "../term";

/** Before what is typed is worked out, ms. */
export const REST_MS = 200;

/** What an alignment would do, and what stands in its way, with another e held (mm) than is configured where one is given;
 *  null until this run of the daemon has said it: another may have another camera. */
export function usePlan(wanted: boolean, eMm: number | null, { bootId, link }: State): Plan | null {
  const [said, say] = useState<{ bootId: string | null; eMm: number | null; plan: Plan } | null>(null);
  const connected = link === "open";
  useEffect(() => {
    if (!wanted || !connected) return undefined;
    let still = true;
    const timer = setTimeout(
      () => {
        void api.plan(eMm === null ? {} : { assembly: { initial_e_mm: eMm } }).then((result) => {
          if (still && result.ok) say({ bootId, eMm, plan: result.value });
        });
      },
      eMm === null ? 0 : REST_MS,
    );
    return () => {
      still = false;
      clearTimeout(timer);
    };
  }, [wanted, eMm, bootId, connected]);
  return wanted && said?.bootId === bootId && said.eMm === eMm ? said.plan : null;
}

/** A kind of job that goes by a plan; undefined for the others. */
function planned(plan: Plan, kind: JobKind) {
  return kind === "joint_alignment" ? { ...plan, kind } : plan.parts.find((part) => part.kind === kind);
}

/** Whether nothing stands in the way of a kind of job. */
export const isPossible = (plan: Plan, kind: JobKind) => (planned(plan, kind)?.obstacles ?? []).length === 0;

/** Where it measures, what the operator will be asked, and how good it is expected to be; or why it cannot be done. */
export function PlanSummary({ plan, kind, unit }: { plan: Plan; kind: JobKind; unit: LengthUnit }) {
  const job = planned(plan, kind);
  if (job === undefined) return null;
  if (job.obstacles.length > 0) {
    return (
      <div class="fault" role="alert" id="plan">
        <p>{strings.plan.impossible}</p>
        <ul>
          {job.obstacles.map((obstacle) => (
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
      <summary>{strings.plan.summary(job.operator_steps.length, job.duration_s)}</summary>
      <ol class="plan-steps">
        {job.operator_steps.map((step, index) => (
          <li key={index}>
            {strings.steps.name(step.name)}
            {step.value === null || step.value === undefined ? "" : `: ${reworded(step.value, unit)}`}
            <SetUpDrawing setup={step.setup} unit={unit} small />
          </li>
        ))}
      </ol>
      {kind === "clarity_only" && typeof job.e_mm === "number" && (
        <p>
          <Explained text={strings.plan.held(length(job.e_mm, unit, 1))} />
        </p>
      )}
      {kind === "joint_alignment" && (
        <>
          <p>
            <Explained
              text={strings.plan.mounted(length(plan.mount_e_mm, unit, 1), pixels(plan.mount_spacing_px, 2))}
            />
          </p>
          <p>
            <Explained
              text={strings.plan.above(
                length(plan.e_mm, unit, 2),
                length(plan.e_tolerance_mm, unit, 2),
                length(plan.e_above_mm, unit, 1),
              )}
            />
          </p>
        </>
      )}
      <p>
        {strings.plan.expected(
          pixels(plan.spacing_sigma_px, 4),
          length(plan.delta_v_sigma_mm, unit, 4),
          length(plan.e_sigma_mm, unit, 3),
        )}{" "}
        <span class="quiet" lang="en">
          {plan.assumed}
        </span>
      </p>
      {plan.by_budget && (
        <p>
          <Explained
            text={strings.plan.byBudget(
              length(plan.by_budget.delta_v_sigma_mm, unit, 3),
              length(plan.by_budget.e_sigma_mm, unit, 2),
            )}
          />{" "}
          {kind === "joint_alignment" && plan.by_budget.e_held_off_mm > 0 && (
            <Explained text={strings.plan.heldOff(length(plan.by_budget.e_held_off_mm, unit, 2))} />
          )}
        </p>
      )}
    </details>
  );
}
