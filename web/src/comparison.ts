// Two runs on one chart: the spacing less its target, iteration by iteration.

import type { Job } from "./wire";

/** x: the iteration's number; then a list for each run, null where it has no such iteration. */
export function comparison(runs: Job[]): [number[], ...(number | null)[][]] {
  const last = Math.max(0, ...runs.flatMap((run) => run.iterations.map((it) => it.number)));
  const numbers = Array.from({ length: last }, (_, index) => index + 1);
  const lists = runs.map((run) => {
    const of = new Map(run.iterations.map((it) => [it.number, it.spacing.spacing_px - it.spacing_target_px]));
    return numbers.map((number) => of.get(number) ?? null);
  });
  return [numbers, ...lists];
}
