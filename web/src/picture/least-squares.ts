// Weighted least squares: what terms make up values best, and how well the values tell them.

export interface Fit {
  /** One for each term. */
  of: number[];
  /** Their covariance, by the values' own uncertainties. */
  covariance: number[][];
  /** χ² by the degrees of freedom: how much more than by those the values scatter, 1 at least. */
  scatter: number;
}

/** The fit to values with their standard uncertainties, a row of terms each; null where they do not tell it. */
export function fit(rows: number[][], values: number[], sigmas: number[]): Fit | null {
  const terms = rows[0]?.length ?? 0;
  const square = Array.from({ length: terms }, () => new Array<number>(2 * terms + 1).fill(0));
  rows.forEach((row, index) => {
    const weight = 1 / (sigmas[index] ?? 1) ** 2;
    square.forEach((line, i) => {
      for (let j = 0; j < terms; j += 1) line[j]! += weight * row[i]! * row[j]!;
      line[terms]! += weight * row[i]! * (values[index] ?? 0);
    });
  });
  // The inverse on the right: it is the covariance.
  square.forEach((line, i) => (line[terms + 1 + i] = 1));
  if (terms === 0 || !solve(square)) return null;
  const of = square.map((line) => line[terms]!);
  const chi = rows.reduce((sum, row, index) => {
    const off = ((values[index] ?? 0) - dot(of, row)) / (sigmas[index] ?? 1);
    return sum + off * off;
  }, 0);
  const scatter = Math.max(1, chi / Math.max(1, rows.length - terms));
  return { of, covariance: square.map((line) => line.slice(terms + 1)), scatter };
}

export function dot(one: number[], other: number[]): number {
  return one.reduce((sum, value, index) => sum + value * (other[index] ?? 0), 0);
}

/** Gauss and Jordan, with pivots. False where it has no one solution. */
function solve(lines: number[][]): boolean {
  const greatest = lines.reduce((most, line, i) => Math.max(most, Math.abs(line[i]!)), 0);
  for (let i = 0; i < lines.length; i += 1) {
    let pivot = i;
    for (let j = i + 1; j < lines.length; j += 1) {
      if (Math.abs(lines[j]![i]!) > Math.abs(lines[pivot]![i]!)) pivot = j;
    }
    [lines[i], lines[pivot]] = [lines[pivot]!, lines[i]!];
    const line = lines[i]!;
    const by = line[i]!;
    if (!(Math.abs(by) > 1e-12 * greatest)) return false;
    for (let k = 0; k < line.length; k += 1) line[k]! /= by;
    for (let j = 0; j < lines.length; j += 1) {
      const share = lines[j]![i]!;
      if (j === i || share === 0) continue;
      for (let k = 0; k < line.length; k += 1) lines[j]![k]! -= share * line[k]!;
    }
  }
  return true;
}
