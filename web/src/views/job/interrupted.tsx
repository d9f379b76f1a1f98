import { useEffect, useState } from "preact/hooks";
import * as api from "../../api";
import { able, isFinal } from "../../state";
import { strings } from "../../strings";
import type { Job } from "../../wire";
import type { Scene } from "../scene";

/** The job that an earlier run of the daemon was at when it ended, where nothing has been done since; null where there is none. */
export function useInterrupted({ state }: Scene): Job | null {
  const [found, setFound] = useState<Job | null>(null);
  const idle = state.bench !== null && state.jobs.length === 0;
  useEffect(() => {
    setFound(null);
    if (!idle) return undefined;
    let wanted = true;
    void cutShort().then((job) => wanted && setFound(job));
    return () => {
      wanted = false;
    };
  }, [idle, state.bootId]);
  return idle ? found : null;
}

async function cutShort(): Promise<Job | null> {
  const newest = await api.jobs(new URLSearchParams({ limit: "1" }));
  const last = newest.ok ? newest.value.jobs[0] : undefined;
  // One that is not over, and not of this run, was cut short as well.
  if (!last || (isFinal(last.state) && last.state !== "interrupted")) return null;
  const job = await api.job(last.id);
  return job.ok ? job.value : null;
}

/** How it goes on from there: step by step, and begun with one press. */
export function WayOn({ state, act, job }: Scene & { job: Job }) {
  const [starting, setStarting] = useState(false);
  const { bench } = state;
  if (!bench) return null;
  const words = strings.job.wayOn;
  // Its air step went with the program.
  const again = job.kind !== "shell_only";
  const held = bench.lease ?? null;
  const others = held !== null && !api.lease.isMine(held);
  const start = async () => {
    setStarting(true);
    await act(api.startJob(job.request));
    setStarting(false);
  };
  return (
    <div class="way-on">
      <h3>{words.title}</h3>
      <ol>
        <li>{words.look}</li>
        {bench.stop.latched && <li>{words.reset}</li>}
        {bench.shell === "unknown" && <li>{words.shell}</li>}
        <li>{again ? words.again : words.airFirst}</li>
      </ol>
      {again && (
        <p class="actions">
          <button
            type="button"
            id="start-again"
            class="primary"
            disabled={starting || bench.stop.latched || others || !able(state, "control")}
            onClick={() => void start()}
          >
            {words.start}: {strings.job.kinds[job.kind]}
          </button>
        </p>
      )}
    </div>
  );
}
