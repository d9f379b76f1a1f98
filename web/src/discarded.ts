// What of a job counts no more, as a step was done again.

import type { Iteration, Job } from "./wire";

/** Whether a step that had begun before this was measured was asked for again after it. */
export function isDiscarded({ steps = [] }: Pick<Job, "steps">, { at }: Pick<Iteration, "at">): boolean {
  const measured = Date.parse(at);
  const began = (text: string | null | undefined) => (text ? Date.parse(text) : NaN);
  return steps.some(
    ({ repeats, began_at }) =>
      typeof repeats === "number" &&
      began(began_at) > measured &&
      steps.some((step) => step.number === repeats && began(step.began_at) <= measured),
  );
}
