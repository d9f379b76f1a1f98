// Two runs on one chart: the spacing less its target, iteration by iteration.

import type { Job } from "../daemon/wire";

/** x: the iteration's number; then a list for each run, null where it has no such iteration that counts. */
export function comparison(runs: Pick<Job, "iterations">[]): [number[], ...(number | null)[][]] {
  const counting = runs.map(({ iterations }) => iterations.filter((it) => !it.discarded));
  const last = Math.max(0, ...counting.flatMap((run) => run.map((it) => it.number)));
  const numbers = Array.from({ length: last }, (_, index) => index + 1);
  const lists = counting.map((run) => {
    const of = new Map(run.map((it) => [it.number, it.spacing.spacing_px - it.spacing_target_px]));
    return numbers.map((number) => of.get(number) ?? null);
  });
  return [numbers, ...lists];
}
