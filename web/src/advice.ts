// The meter's reading as a sentence: what is to be moved, which way, how far.

import type { Correction } from "./correction";
import { fixed } from "./format";
import type { Reading } from "./reading";
import { strings } from "./strings";
import { length, signedLength, type LengthUnit } from "./units";

/** What is moved now: the camera in its shell, or MLA and sensor behind the lens. */
export type Moved = "e" | "delta_v";

export interface Advice {
  /** What to do. */
  main: string;
  /** What would do as well. */
  other: string | null;
}

/** `reaches` is whether an axis can go so far from where it is, mm. */
export function advice(
  reading: Reading,
  correction: Correction | null,
  moved: Moved,
  unit: LengthUnit,
  reaches: (moved: Moved, byMm: number) => boolean = () => true,
): Advice {
  const words = strings.meter;
  if (reading.direction === "there")
    return { main: words.thereMore(fixed(reading.tolerancePx, 3)), other: null };
  if (reading.direction === "levels") return { main: words.levelsMore, other: null };
  if (reading.direction === "doubted") return { main: words.doubtedMore(reading.unresolved), other: null };
  if (reading.twoBoards) {
    const { spacings_px, share } = reading.twoBoards;
    const [larger, smaller] = spacings_px.map((spacing) => fixed(spacing, 2));
    return { main: words.twoBoards(larger ?? "", smaller ?? "", fixed(100 * share, 0)), other: null };
  }
  if (reading.direction === "unsure") return { main: words.unsureMore, other: null };
  const way = reading.direction === "larger" ? words.farther : words.nearer;
  if (!correction) return { main: reading.pitchPx === null ? way : words.tooFar(way), other: null };
  const { deltaVMm, eMm } = correction;
  const apart = length(Math.abs(deltaVMm), unit, 4);
  if (moved === "e" && eMm !== null) {
    const other = reaches("delta_v", deltaVMm) ? words.or(signedLength(deltaVMm, unit, 4)) : null;
    if (!reaches("e", eMm)) return { main: words.pastTravel(way), other };
    const far = length(Math.abs(eMm), unit, 2);
    return {
      main: eMm > 0 ? words.away(far) : words.towards(far),
      other,
    };
  }
  if (!reaches("delta_v", deltaVMm)) return { main: words.pastTravel(way), other: null };
  return { main: deltaVMm > 0 ? words.grow(apart) : words.shrink(apart), other: null };
}
