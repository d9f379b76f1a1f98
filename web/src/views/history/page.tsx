import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { everything, queryOf, type Filter } from "../../job/query";
import { addressOf, COMPARED } from "../../browser/route";
import { isFinal } from "../../state";
import { strings } from "../../strings";
import type { Job, JobItem } from "../../daemon/wire";
import type { Given } from "../given";
import { Compare } from "./compare";
import { Filters } from "./filters";
import { JobTable } from "./table";

/** Before a search goes out while somebody types, ms. */
const REST_MS = 250;

/** The jobs of this run and of earlier ones. */
export function HistoryPage(given: Given) {
  const { state } = given;
  const [filter, setFilter] = useState<Filter>(everything);
  const [jobs, setJobs] = useState<JobItem[] | null>(null);
  const [next, setNext] = useState<string | null>(null);
  const [fault, setFault] = useState<string | null>(null);
  const chosen = state.route.jobs;

  const load = (cursor: string | null, had: JobItem[], wanted: () => boolean) =>
    given.load(
      api.jobs(queryOf(filter, cursor)).then((result) => {
        if (result.ok && wanted()) {
          setJobs([...had, ...result.value.jobs]);
          setNext(result.value.next ?? null);
          setFault(result.value.history_fault ?? null);
        }
        return result;
      }),
    );

  const asked = useRef(filter);
  asked.current = filter;

  // Anew with another filter, after a job has begun or ended, and when the daemon is back.
  const begun = state.jobs.length;
  const ended = state.jobs.filter((job) => isFinal(job.state)).length;
  useEffect(() => {
    let wanted = state.link !== "lost";
    const timer = setTimeout(() => wanted && void load(null, [], () => wanted), REST_MS);
    return () => {
      wanted = false;
      clearTimeout(timer);
    };
  }, [filter, begun, ended, state.bootId, state.link]);

  const choose = (id: string, on: boolean) => {
    const rest = chosen.filter((one) => one !== id);
    location.hash = addressOf("history", ...(on ? [...rest, id].slice(-COMPARED) : rest));
  };
  return (
    <div class="history-page">
      <section class="card">
        <h2>{strings.history.title}</h2>
        <Filters filter={filter} set={setFilter} />
        {fault && (
          <p class="tag bad">
            {strings.history.missing}: {fault}
          </p>
        )}
        {jobs && (
          <JobTable
            jobs={jobs.map((job) => followed(job, state.jobs))}
            chosen={chosen}
            unit={state.preferences.unit}
            choose={choose}
          />
        )}
        {jobs?.length === 0 && <p>{strings.history.none}</p>}
        {next && (
          <p class="actions">
            <button type="button" onClick={() => void load(next, jobs ?? [], () => asked.current === filter)}>
              {strings.history.more}
            </button>
          </p>
        )}
        <p class="quiet hint">{strings.history.compareMore}</p>
      </section>
      {chosen.length > 0 && <Compare {...given} ids={chosen} />}
    </div>
  );
}

/** A job as it is by now: what is under way goes on after it was listed. */
function followed(listed: JobItem, jobs: Job[]): JobItem {
  const job = jobs.find(({ id }) => id === listed.id);
  if (!job) return listed;
  const { state, reason = null, progress, iterations, recording = null } = job;
  return { ...listed, state, reason, progress, iterations: iterations.length, recording };
}
