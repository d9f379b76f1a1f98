// Lengths in the unit that whoever looks has chosen.

import { fixed, signed } from "./format";

export type LengthUnit = "mm" | "µm";

function scaled(mm: number, unit: LengthUnit, digits: number): [number, number] {
  return unit === "mm" ? [mm, digits] : [mm * 1000, Math.max(0, digits - 3)];
}

/** A length given in mm, with its unit; `digits` are those in mm. */
export function length(mm: number, unit: LengthUnit, digits = 3): string {
  const [value, places] = scaled(mm, unit, digits);
  return `${fixed(value, places)} ${unit}`;
}

/** The same, with its sign. */
export function signedLength(mm: number, unit: LengthUnit, digits = 3): string {
  const [value, places] = scaled(mm, unit, digits);
  return `${signed(value, places)} ${unit}`;
}
