// Why a job has ended as it has, where that says more than its state does.

import type { Job } from "../daemon/wire";

/** Reasons that only repeat the state. */
const REPEATS = ["done", "cancelled"];

/** What is to be said beside a job's state; null where nothing more is known. */
export function reasonOf({ reason }: Pick<Job, "reason">): string | null {
  return reason && !REPEATS.includes(reason) ? reason : null;
}
