import { movedSince } from "../../job/moved-since";
import { strings } from "../../strings";
import type { Job } from "../../daemon/wire";
import type { Given } from "../given";

/** That the camera does not stand any more as the newest job has left it. */
export function MovedSince({ job, state }: Given & { job: Job }) {
  const since = movedSince(job, state.bench);
  return since && <p class="moved-since">{strings.job.since[since]}</p>;
}
