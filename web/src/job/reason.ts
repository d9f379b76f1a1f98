// Why a job has ended as it has, where that says more than its state does.

import type { Job } from "../daemon/wire";

/** What only repeats the state that stands beside it. */
const REPEATS = /^(done$|cancelled\b *)/;

/** What is to be said beside a job's state; null where nothing more is known. */
export function reasonOf({ reason }: Pick<Job, "reason">): string | null {
  return reason?.replace(REPEATS, "") || null;
}
