import { moment } from "../../words/format";
import { addressOf } from "../../browser/route";
import { reasonOf } from "../../job/reason";
import { strings } from "../../strings";
import { reached, reworded, type LengthUnit } from "../../words/units";
import type { JobItem } from "../../daemon/wire";
import { Downloads } from "../job/downloads";
import { Toggle } from "../toggle";

interface Props {
  jobs: JobItem[];
  chosen: string[];
  unit: LengthUnit;
  choose: (id: string, on: boolean) => void;
}

/** Jobs, newest first. */
export function JobTable({ jobs, chosen, unit, choose }: Props) {
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
              unit={unit}
              chosen={chosen.includes(job.id)}
              choose={(on) => choose(job.id, on)}
            />
          ))}
        </tbody>
      </table>
    </div>
  );
}

interface RowProps {
  job: JobItem;
  chosen: boolean;
  unit: LengthUnit;
  choose: (on: boolean) => void;
}

function JobRow({ job, chosen, unit, choose }: RowProps) {
  const words = strings.history;
  const when = moment(job.created_at);
  const what = strings.job.kinds[job.kind];
  const measure = job.progress.measure;
  const reason = reasonOf(job);
  return (
    <tr>
      <td class="words">
        <a href={addressOf("alignment", job.id)}>{when}</a>
      </td>
      <td class="words">
        {what}
        {job.simulated && <span class="tag">{words.simulated}</span>}
        {job.note && <p class="quiet">{job.note}</p>}
        {job.owner && <p class="quiet">{words.startedBy(job.owner)}</p>}
      </td>
      <td class="words">
        <span class={`outcome ${job.state}`} data-reason={reason !== null}>
          {strings.job.state[job.state]}
        </span>
        {reason !== null && (
          <span class="quiet reason-of" lang="en">
            {" "}
            {reworded(reason, unit)}
          </span>
        )}
      </td>
      <td>{measure ? `${strings.job.of(measure.name)} ${reached(measure, unit).value}` : "—"}</td>
      <td>{job.iterations}</td>
      <td class="words">
        <Downloads href={job.href} recording={job.recording} />
      </td>
      <td>
        <Toggle on={chosen} set={choose} title={words.compareThis(`${what}, ${when}`)}>
          {words.compare}
        </Toggle>
      </td>
    </tr>
  );
}
