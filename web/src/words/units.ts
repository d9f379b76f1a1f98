// Figures with their units, as the page shows them: the one place that knows how a length is spelt in the unit that
// whoever looks has chosen. What is computed with stays in mm.

import { fixed, signed, withSigma } from "./format";

export type LengthUnit = "mm" | "µm";
export const UNITS: readonly LengthUnit[] = ["mm", "µm"];

const UM_IN_MM = 1000;
/** Digits that a figure in µm has less than the same in mm. */
const FEWER = 3;

/** A length given in mm, as a number of the unit. */
export function inUnit(mm: number, unit: LengthUnit): number {
  return unit === "mm" ? mm : mm * UM_IN_MM;
}

/** A number of the unit, in mm. */
export function toMm(value: number, unit: LengthUnit): number {
  return unit === "mm" ? value : value / UM_IN_MM;
}

/** Digits of a figure that has `digits` in mm. */
function places(digits: number, unit: LengthUnit): number {
  return unit === "mm" ? digits : Math.max(0, digits - FEWER);
}

/** A length given in mm, with so many digits of that in the unit: as exact in one as in the other, and the same. */
function shown(mm: number, unit: LengthUnit, digits: number): number {
  return unit === "mm" || !Number.isFinite(mm) ? inUnit(mm, unit) : inUnit(Number(mm.toFixed(digits)), unit);
}

/** A length given in mm, without its unit, as in a table that names it in its head; `digits` are those in mm. */
export function bare(mm: number, unit: LengthUnit, digits = 3): string {
  return fixed(shown(mm, unit, digits), places(digits, unit));
}

/** A length given in mm, with its unit; `digits` are those in mm. */
export function length(mm: number, unit: LengthUnit, digits = 3): string {
  return `${bare(mm, unit, digits)} ${unit}`;
}

/** The same, with its sign. */
export function signedLength(mm: number, unit: LengthUnit, digits = 3): string {
  return `${signed(shown(mm, unit, digits), places(digits, unit))} ${unit}`;
}

/** Several lengths and their unit once. */
export function lengths(mm: number[], unit: LengthUnit, digits = 3): string {
  return `${mm.map((one) => bare(one, unit, digits)).join(", ")} ${unit}`;
}

/** A length with its standard uncertainty, both in mm, without their unit; null where it is not known. */
export function bareMeasured(
  mm: number | null | undefined,
  sigmaMm: number | null | undefined,
  unit: LengthUnit,
  digits: number,
): string | null {
  const of = (value: number | null | undefined) =>
    value === null || value === undefined ? value : inUnit(value, unit);
  return withSigma(of(mm), of(sigmaMm), places(digits, unit));
}

/** The same with the unit. */
export function measuredLength(
  mm: number | null | undefined,
  sigmaMm: number | null | undefined,
  unit: LengthUnit,
  digits: number,
): string | null {
  const text = bareMeasured(mm, sigmaMm, unit, digits);
  return text === null ? null : `${text} ${unit}`;
}

/** A length as it stands in a field to be edited: every digit that it has, and none that the change of units makes up. */
export function plain(mm: number, unit: LengthUnit): string {
  return String(rounded(inUnit(mm, unit)));
}

/** What is typed in the unit, in mm, without the digits that the change of units makes up. */
export function typedMm(value: number, unit: LengthUnit): number {
  return rounded(toMm(value, unit));
}

function rounded(value: number): number {
  return Number(value.toPrecision(12));
}

/** A length in pixels of the sensor. */
export function pixels(px: number, digits: number): string {
  return `${fixed(px, digits)} px`;
}

/** A length in pixels with its standard uncertainty; null where it is not known. */
export function measuredPixels(
  px: number | null | undefined,
  sigmaPx: number | null | undefined,
  digits: number,
): string | null {
  const text = withSigma(px, sigmaPx, digits);
  return text === null ? null : `${text} px`;
}

/** Pixels to a length: given to a mm, shown to the unit; `digits` are those of px/mm. */
export function pixelsPer(pxPerMm: number, unit: LengthUnit, digits: number): string {
  return unit === "mm"
    ? `${fixed(pxPerMm, digits)} px/mm`
    : `${fixed(pxPerMm / UM_IN_MM, digits + FEWER)} px/µm`;
}

/** Pixels an hour, with their standard uncertainty where it is told. */
export function pixelsAnHour(px: number, sigma: number | null | undefined, digits: number): string {
  const known = typeof sigma === "number" ? ` ± ${fixed(sigma, digits)}` : "";
  return `${fixed(px, digits)}${known} px/h`;
}

/** An angle. */
export function angle(degrees: number, digits: number): string {
  return `${fixed(degrees, digits)}°`;
}

/** An angle with its sign. */
export function signedAngle(degrees: number, digits: number): string {
  return `${signed(degrees, digits)}°`;
}

/** What a job reaches for: a length in mm, or the spacing in px. */
interface Reached {
  name: string;
  value: number;
  sigma: number;
  target?: number | null | undefined;
}

/** A job's figure with its standard uncertainty, and its target; each with its unit. */
export function reached(measure: Reached, unit: LengthUnit): { value: string; target: string | null } {
  const { name, value, sigma, target } = measure;
  const isLength = name.endsWith("_mm");
  const text = isLength ? measuredLength(value, sigma, unit, 4) : measuredPixels(value, sigma, 4);
  const aim = typeof target !== "number" ? null : isLength ? length(target, unit, 4) : pixels(target, 4);
  return { value: text ?? "", target: aim };
}

/** Lengths in the daemon's own words: a number, or several, or one with its uncertainty, and then "mm"; nothing that is divided by
 *  or squared. */
const SAID =
  /(?<![\w.,/])([+−-]?\d+(?:\.\d+)?(?:(?:, | to | and |–|…| ± |±)[+−-]?\d+(?:\.\d+)?)*) mm\b(?![²³/])/g;

/** What the daemon says, with its lengths in the unit. */
export function reworded(text: string, unit: LengthUnit): string {
  if (unit === "mm") return text;
  return text.replace(SAID, (_all, numbers: string) => {
    const spelt = numbers.replace(/\d+(?:\.\d+)?/g, (number) => {
      const digits = number.split(".")[1]?.length ?? 0;
      return bare(Number(number), unit, digits);
    });
    return `${spelt} ${unit}`;
  });
}
