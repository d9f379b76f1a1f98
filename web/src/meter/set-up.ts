// What a reading is of: the shell, and what stands before the lens. What was read of another scene says nothing of this one.

import type { Bench, Job } from "../daemon/wire";

/** When what stands before the camera was set up as it is, the daemon's clock, ms. */
export function setUpAt(bench: Bench | null): number {
  const at = Date.parse(bench?.set_up_at ?? "");
  return Number.isFinite(at) ? at : -Infinity;
}

/** Whether the operator is at it: nothing is known of the scene until it is confirmed, and the bench tells what stands there. */
export function isBeingSetUp(bench: Bench | null, job: Job | null): boolean {
  if (bench?.in_view !== "unknown" || !job) return false;
  // The job goes on a moment before the bench says so. An aperture that is set leaves before the lens what stands there.
  const setup = job.steps?.find(({ state }) => state === "now")?.setup;
  return job.state === "waiting_for_operator" || (setup ? setup.type !== "aperture" : false);
}

/** Whether the spacing's change over the field may be a tilt: over a board of several levels it is the board's, and one of which
 *  nobody has said what it is may be such a one. */
export function showsTilt(bench: Bench | null): boolean {
  return bench?.in_view === "flat_board" || bench?.in_view === "board_elsewhere";
}

/** Whether it is known if an axis moves: of one that is not connected it is not. */
export function knowsMotion(bench: Bench | null): boolean {
  return bench?.axes.every((axis) => axis.connected) ?? false;
}

/** What a reading has to be judged by. */
export interface Scene {
  /** Whether a job would set Δv, in air, and not e through the shell. */
  inAir: boolean;
  /** Why its spacing is not to be compared with the target, where it is not: of a board of several levels that of the whole
   *  field is of none of them, one that stands elsewhere than where the camera is to be focused has another target, of one that
   *  nobody has asked for it is not known where it stands, and while nobody has said whether the shell is on, which target it
   *  has. */
  otherwise: "levels" | "elsewhere" | "unasked" | "unsaid" | null;
}

export function sceneOf(bench: Bench | null): Scene {
  const inAir = bench?.shell !== "on";
  if (bench?.in_view === "stepped_board") return { inAir, otherwise: "levels" };
  if (bench?.in_view === "board_elsewhere") return { inAir, otherwise: "elsewhere" };
  if (bench?.in_view === "other") return { inAir, otherwise: "unasked" };
  return { inAir, otherwise: bench?.shell === "unknown" ? "unsaid" : null };
}
