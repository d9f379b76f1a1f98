// The meter's reading as a sentence: what is to be moved, which way, how far.

import type { Correction } from "./correction";
import { fixed } from "../words/format";
import type { Direction, Reading } from "./reading";
import { strings } from "../strings";
import { length, signedLength, type LengthUnit } from "../words/units";

/** What is moved now: the camera in its shell, or MLA and sensor behind the lens. */
export type Moved = "e" | "delta_v";

export interface Advice {
  /** What to do. */
  main: string;
  /** What would do as well. */
  other: string | null;
}

/** What hinders an axis now from going so far from where it is, mm, or from going at all where that is null; null where nothing
 *  does. */
export type Hinders = (moved: Moved, byMm: number | null) => string | null;

/** What a reading calls for, of what can be done. */
export function advice(
  reading: Reading,
  correction: Correction | null,
  moved: Moved,
  unit: LengthUnit,
  hinders: Hinders = () => null,
): Advice {
  const words = strings.meter;
  if (reading.direction === "there")
    return { main: words.thereMore(fixed(reading.tolerancePx, 4)), other: null };
  const orderless: Partial<Record<Direction, string>> = words.orderless;
  const why = orderless[reading.direction];
  if (why !== undefined) return { main: why, other: null };
  if (reading.direction === "doubted") return { main: words.doubtedMore(reading.unresolved), other: null };
  if (reading.twoBoards) {
    const { spacings_px, share } = reading.twoBoards;
    const [larger, smaller] = spacings_px.map((spacing) => fixed(spacing, 2));
    return { main: words.twoBoards(larger ?? "", smaller ?? "", fixed(100 * share, 0)), other: null };
  }
  if (reading.direction === "unsure") return { main: words.unsureMore, other: null };
  const { deltaVMm, eMm } = correction ?? { deltaVMm: null, eMm: null };
  const focus = hinders("delta_v", deltaVMm);
  // With the shell off there is no e to be moved.
  const e = moved === "e" ? hinders("e", eMm) : focus;
  // It is homed soon; what the air step has set is not given away meanwhile.
  const { onSwitch, unhomed } = words.hindered;
  if (e === onSwitch.e || e === unhomed.e) return { main: e, other: null };
  if (e !== null && focus !== null) return { main: e === focus ? e : `${e}. ${focus}`, other: null };
  const way = (reading.direction === "larger" ? words.grows : words.shrinks)[moved];
  if (deltaVMm === null) return { main: reading.pitchPx === null ? way : words.tooFar(way), other: null };
  if (moved === "e" && e === null && eMm !== null) {
    const far = length(Math.abs(eMm), unit, 2);
    const other = focus === null ? words.or(signedLength(deltaVMm, unit, 4)) : null;
    return { main: eMm > 0 ? words.away(far) : words.towards(far), other };
  }
  // How far e would have to go is not known.
  if (focus !== null) return { main: `${focus}: ${way}`, other: null };
  const apart = length(Math.abs(deltaVMm), unit, 4);
  const array = deltaVMm > 0 ? words.grow(apart) : words.shrink(apart);
  return { main: e === null ? array : `${e}. ${array}`, other: null };
}
