// What keeps an axis from going where the meter would have it go.

import type { Moved } from "./advice";
import { strings } from "../strings";
import type { Bench } from "../daemon/wire";

/** What hinders an axis from going so far from where it is, mm, or at all where that is null; null where nothing is known to. */
export function hindrance(bench: Bench | null, moved: Moved, byMm: number | null): string | null {
  const words = strings.meter.hindered;
  if (bench?.stop.latched) return words.stopped;
  if (bench?.history_fault) return words.history;
  if (bench?.contradicted) return words.contradicted;
  const axis = bench?.axes.find(({ axis }) => axis === (moved === "e" ? "e" : "focus"));
  if (!axis) return null;
  // Its homing is refused until it is off the switch.
  if (axis.connected && !axis.homed) return (axis.limit_switch ? words.onSwitch : words.unhomed)[moved];
  if (!axis.connected || axis.fault) return words.out[moved];
  if (byMm === null || typeof axis.position_mm !== "number") return null;
  const at = axis.position_mm + byMm;
  return at < axis.low_limit_mm || at > axis.high_limit_mm ? words.past[moved] : null;
}
