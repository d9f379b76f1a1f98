import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { isFinal } from "../../state";
import type { Job } from "../../daemon/wire";
import type { Given } from "../given";

/** The job that an earlier run of the daemon was at when it ended, where nothing has been done since; null where there is none. */
export function useInterrupted({ state }: Given): Job | null {
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
  if (!last || (isFinal(last.state) && last.state !== "interrupted")) return null;
  const job = await api.job(last.id);
  // One that is not over, and not of this run, was cut short as well, although that could not be written.
  return job.ok ? { ...job.value, state: "interrupted" } : null;
}
