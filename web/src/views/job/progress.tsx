import { fixed } from "../../format";
import { strings } from "../../strings";
import type { Job } from "../../wire";

/** Seconds in words. */
function time(seconds: number): string {
  return seconds < 90 ? `${Math.ceil(seconds)} s` : `${Math.ceil(seconds / 60)} min`;
}

/** How far a job is, and how near its figure is to the target. */
export function Progress({ job }: { job: Job }) {
  const { step, of, doing, measure, time_left_s: left } = job.progress;
  const unit = measure?.name === "delta_v_mm" ? "mm" : "px";
  return (
    <div class="progress">
      <progress value={step} max={Math.max(1, of)} aria-label={strings.job.progress(step, of)} />
      <p class="facts">
        <span>{strings.job.progress(step, of)}</span>
        {typeof left === "number" && <span>{strings.job.left(time(left))}</span>}
        {measure && (
          <span>
            {strings.job.of(measure.name)} {fixed(measure.value, 4)} ± {fixed(measure.sigma, 4)} {unit}
            {typeof measure.target === "number" &&
              `, ${strings.meter.target} ${fixed(measure.target, 4)} ${unit}`}
          </span>
        )}
      </p>
      <p>{doing}</p>
    </div>
  );
}
