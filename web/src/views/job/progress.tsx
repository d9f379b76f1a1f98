import { wait } from "../../words/format";
import { strings } from "../../strings";
import { reached, reworded, type LengthUnit } from "../../words/units";
import type { Job } from "../../daemon/wire";

/** How far a job is, and how near its figure is to the target. */
export function Progress({ job, unit }: { job: Job; unit: LengthUnit }) {
  const { step, of, doing, measure, time_left_s: left } = job.progress;
  return (
    <div class="progress">
      <progress value={step} max={Math.max(1, of)} aria-label={strings.job.progress(step, of)} />
      <p class="facts">
        <span>{strings.job.progress(step, of)}</span>
        {typeof left === "number" && <span>{strings.job.left(wait(left))}</span>}
        {measure && <span>{figure(measure, unit)}</span>}
      </p>
      <p lang="en">{reworded(doing, unit)}</p>
    </div>
  );
}

function figure(measure: NonNullable<Job["progress"]["measure"]>, unit: LengthUnit): string {
  const { value, target } = reached(measure, unit);
  const of = strings.job.of(measure.name);
  return target === null ? strings.job.figure(of, value) : strings.job.figureAimed(of, value, target);
}
