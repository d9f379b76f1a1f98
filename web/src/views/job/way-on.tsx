import { useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { barred } from "../../job/barred";
import { able, may } from "../../state";
import { strings } from "../../strings";
import { wayOn } from "../../job/way-on";
import type { Job, JobRequest } from "../../daemon/wire";
import type { Given } from "../given";

/** Whether nobody has seen to where a job left the axes: where the program ended, or where the job would have brought an axis back,
 *  or had its motor switched off. */
function leftInTheMiddle({ state, kind }: Job): boolean {
  return (
    state === "interrupted" ||
    (state === "cancelled" && (kind === "focus_sweep" || kind === "l_bound_measurement"))
  );
}

/** After a job that ended early: what still holds of it, what to see to first, and the buttons to go on. */
export function WayOn({ state, act, job }: Given & { job: Job }) {
  const [starting, setStarting] = useState(false);
  const { bench } = state;
  const on = wayOn(job, bench);
  if (!bench || !on || !may(state, "control")) return null;
  const words = strings.wayOn;
  const free = api.lease.other(bench.lease) === null;
  const ready = !starting && free && !bench.stop.latched && !bench.history_fault && able(state, "control");
  const barring = [...new Set(on.ways.flatMap(({ request }) => barred(bench, request)))];
  const notes = [
    leftInTheMiddle(job) && words.look,
    bench.shell === "unknown" && words.shell,
    on.airStep && words.airStep[on.airStep],
    bench.stop.latched && words.resetFirst,
    ...barring,
  ].filter((note) => typeof note === "string");
  const start = async (request: JobRequest) => {
    setStarting(true);
    await act(api.startJob(request));
    setStarting(false);
  };
  return (
    <div class="way-on" role="group" aria-label={words.title}>
      <h3>{words.title}</h3>
      {notes.length > 0 && (
        <ul>
          {notes.map((note) => (
            <li key={note}>{note}</li>
          ))}
        </ul>
      )}
      <p class="actions">
        {on.ways.map(({ is, request }, index) => (
          <button
            key={is}
            type="button"
            class={index === 0 ? "primary" : undefined}
            data-way={is}
            disabled={!ready || barred(bench, request).length > 0}
            title={strings.job.meaning[request.kind]}
            onClick={() => void start(request)}
          >
            {words[is](strings.job.kinds[request.kind])}
          </button>
        ))}
      </p>
    </div>
  );
}
