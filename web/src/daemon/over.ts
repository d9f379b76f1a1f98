// When what went wrong is over by itself: what stands above every page is to hold while it stands there.

import type { Bench, Problem } from "./wire";

/** A command that was refused because an axis moved. */
export const MOVING = "urn:plenalign:problem:moving";

/** Whether what the bench says now ends a problem. */
export function isOver({ type, axis }: Problem, bench: Bench): boolean {
  return type === MOVING && bench.axes.some((one) => one.axis === axis && !one.moving);
}
