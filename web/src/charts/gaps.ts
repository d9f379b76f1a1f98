// Where a chart has no line: between two points so far apart that something is missing there.

/** One of the points that a chart has of something. */
type Value = number | null;

/** A gap is longer than the middle one of all steps from point to point by this factor. */
const OF_USUAL = 1.8;

/** A chart's points with nothing in the middle of each gap: of two that are further apart than usual, and by more than `leastS`.
 *  `at` rises. */
export function broken(at: number[], curves: Value[][], leastS = 0): [number[], ...Value[][]] {
  const steps = at.slice(1).map((time, index) => time - (at[index] ?? time));
  const usual = [...steps].sort((one, other) => one - other)[Math.floor(steps.length / 2)] ?? 0;
  const most = Math.max(leastS, OF_USUAL * usual);
  const gaps = new Set(steps.flatMap((step, index) => (step > most ? [index] : [])));
  const middle = (index: number) => ((at[index] ?? 0) + (at[index + 1] ?? 0)) / 2;
  return [
    at.flatMap((time, index) => (gaps.has(index) ? [time, middle(index)] : [time])),
    ...curves.map((curve) => curve.flatMap((value, index) => (gaps.has(index) ? [value, null] : [value]))),
  ];
}
