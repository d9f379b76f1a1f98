import { withSigma } from "../../format";
import { addressOf } from "../../route";
import { strings } from "../../strings";
import type { JobItem } from "../../wire";
import { Downloads } from "../job/downloads";
import { Toggle } from "../toggle";

interface Props {
  jobs: JobItem[];
  chosen: string[];
  choose: (id: string, on: boolean) => void;
}

/** Jobs, newest first. */
export function JobTable({ jobs, chosen, choose }: Props) {
  if (jobs.length === 0) return null;
  const words = strings.history;
  return (
    <div class="table">
      <table class="jobs">
        <thead>
          <tr>
            {[
              words.when,
              words.what,
              words.outcome,
              words.measure,
              words.iterations,
              words.files,
              words.compare,
            ].map((name) => (
              <th key={name} scope="col">
                {name}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {jobs.map((job) => (
            <JobRow
              key={job.id}
              job={job}
              chosen={chosen.includes(job.id)}
              choose={(on) => choose(job.id, on)}
            />
          ))}
        </tbody>
      </table>
    </div>
  );
}

function JobRow({ job, chosen, choose }: { job: JobItem; chosen: boolean; choose: (on: boolean) => void }) {
  const when = new Date(job.created_at).toLocaleString();
  const what = strings.job.kinds[job.kind];
  const measure = job.progress.measure;
  const unit = measure?.name === "delta_v_mm" ? "mm" : "px";
  return (
    <tr>
      <td class="words">
        <a href={addressOf("alignment", job.id)}>{when}</a>
      </td>
      <td class="words">
        {what}
        {job.simulated && <span class="tag">{strings.simulated.toLowerCase()}</span>}
      </td>
      <td class="words">
        <span class={`outcome ${job.state}`}>{strings.job.state[job.state]}</span>
        {job.reason && <span class="quiet reason-of"> {job.reason}</span>}
      </td>
      <td>
        {measure
          ? `${strings.job.of(measure.name)} ${withSigma(measure.value, measure.sigma, 4)} ${unit}`
          : "—"}
      </td>
      <td>{job.iterations}</td>
      <td class="words">
        <Downloads href={job.href} recording={job.recording} />
      </td>
      <td>
        <Toggle on={chosen} set={choose} title={strings.history.compareThis(`${what}, ${when}`)}>
          {strings.history.compare}
        </Toggle>
      </td>
    </tr>
  );
}
