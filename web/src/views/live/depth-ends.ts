import type { State } from "../../state";
import { strings } from "../../strings";
import { length } from "../../words/units";

/** What the ends of a depth map's colours stand for, in words. */
export function depthEnds({ picture, missing, reading, preferences }: State): { far: string; near: string } {
  // Distances go by the spacing: of a frame whose spacing is not told they are not told either.
  const untold = missing !== null || reading?.direction === "doubted";
  const words = strings.picture;
  const end = (mm: number | null | undefined) =>
    typeof mm === "number" && !untold ? length(mm, preferences.unit, 0) : words.legendAway;
  return {
    far: `${words.legendFar} ${end(picture?.farMm)}`,
    near: `${words.legendNear} ${end(picture?.nearMm)}`,
  };
}
