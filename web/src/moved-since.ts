// Whether the camera still is as a job has left it.

import type { Bench, Job } from "./wire";

/** An axis whose readback has changed by more than this has been moved, mm: a servo that holds its place may read a micrometre
 *  beside it. */
const MOVED_MM = 2e-3;

/** Whether an axis stands elsewhere than when an alignment ended, or its place has been lost since. */
export function movedSince({ report }: Pick<Job, "report">, bench: Bench | null): boolean {
  if (!report || !bench) return false;
  const then = { focus: report.focus_readback_mm, e: report.e_readback_mm };
  return bench.axes.some(({ axis, position_mm: now }) => {
    const at = then[axis];
    return typeof at === "number" && (typeof now !== "number" || Math.abs(now - at) > MOVED_MM);
  });
}
