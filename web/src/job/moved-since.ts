// Whether an axis stands where it stood, and the camera is as a job has left it.

import type { Bench, Job } from "../daemon/wire";

/** An axis whose readback has changed by more than this has been moved, mm: a servo that holds its place may read a micrometre
 *  beside it. */
const MOVED_MM = 2e-3;

/** Whether an axis does not stand where it stood, mm; of two places that are not known nothing is said. */
export function hasMoved(then: number | null | undefined, now: number | null | undefined): boolean {
  return typeof then === "number" && typeof now === "number" && Math.abs(now - then) > MOVED_MM;
}

/** Whether an axis stands elsewhere than when an alignment ended, or its place has been lost since. */
export function movedSince({ report }: Pick<Job, "report">, bench: Bench | null): "moved" | "lost" | null {
  if (!report || !bench) return null;
  const then = { focus: report.focus_readback_mm, e: report.e_readback_mm };
  if (bench.axes.some(({ axis, position_mm: now }) => hasMoved(then[axis], now))) return "moved";
  const lost = bench.axes.some(
    ({ axis, position_mm: now }) => typeof then[axis] === "number" && typeof now !== "number",
  );
  return lost ? "lost" : null;
}
