// What can be done after a job that ended before its end.

import { unhomed } from "./barred";
import { isFinal } from "../state";
import type { Bench, Job, JobRequest } from "../daemon/wire";

export interface WayOn {
  /** Whether what the air step did still serves; null where the job has none. */
  airStep: "holds" | "doubtful" | "gone" | null;
  /** The best first. */
  ways: { is: "goOn" | "again"; request: JobRequest }[];
}

/** The ways on from a job; null where it came to its end. */
export function wayOn(job: Job, bench: Bench | null): WayOn | null {
  if (!isFinal(job.state) || job.state === "converged" || job.state === "succeeded") return null;
  const again = { is: "again" as const, request: job.request };
  const lost = bench && unhomed(bench, job.request);
  if (lost) {
    const home = { is: "goOn" as const, request: { kind: "homing" as const, axes: [lost] } };
    return { airStep: null, ways: [home, again] };
  }
  if (job.kind !== "joint_alignment" && job.kind !== "shell_only") return { airStep: null, ways: [again] };
  const { note, record } = job.request;
  const more = { ...(note ? { note } : {}), ...(record ? { record } : {}) };
  const whole = { is: "again" as const, request: { kind: "joint_alignment" as const, ...more } };
  if (!bench?.air_step_holds) return { airStep: "gone", ways: [whole] };
  const shell = { is: "goOn" as const, request: { kind: "shell_only" as const, ...more } };
  // What contradicts the picture through the shell may be the air step itself.
  if (bench.contradicted) return { airStep: "doubtful", ways: [whole, shell] };
  return { airStep: "holds", ways: [shell, whole] };
}
