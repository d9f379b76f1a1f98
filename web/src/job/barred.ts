// What keeps a job from beginning: an axis or a camera that is not there; homing is refused while a limit switch is pressed,
// and nothing else moves before it; a sweep goes between places, which there are none of before homing; and the shell step
// goes on from an air step.

import { strings } from "../strings";
import type { AxisName, Bench, JobKind } from "../daemon/wire";

/** What a job is asked for with, as far as it tells which axes it moves. */
interface Asked {
  kind: JobKind;
  axis?: AxisName;
  axes?: readonly AxisName[] | null;
}

/** The axes that a job moves. */
function movedBy({ kind, axis, axes }: Asked): readonly AxisName[] {
  switch (kind) {
    case "spacing_watch":
    case "calibration":
      return [];
    case "focus_sweep":
      return axis ? [axis] : [];
    case "homing":
      return axes?.length ? axes : ["focus", "e"];
    default:
      return ["focus", "e"];
  }
}

/** Those of them that stand on a limit switch, and have to be moved off it first. */
export function switched(bench: Bench, asked: Asked): AxisName[] {
  const pressed = bench.axes.filter((one) => one.connected && one.limit_switch).map(({ axis }) => axis);
  return movedBy(asked).filter((axis) => pressed.includes(axis));
}

/** The axis whose places a job is told, and that has none yet. */
export function unhomed(bench: Bench, { kind, axis }: Asked): AxisName | null {
  if (kind !== "focus_sweep") return null;
  return bench.axes.some((one) => one.axis === axis && !one.homed) ? (axis ?? null) : null;
}

/** The axes that it moves and whose line is lost. */
function unplugged(bench: Bench, asked: Asked): AxisName[] {
  return movedBy(asked).filter((axis) => bench.axes.some((one) => one.axis === axis && !one.connected));
}

/** What a job needs that is not there, and what to do first, in words. */
export function absent(bench: Bench, asked: Asked): string[] {
  const { plugFirst, cameraFirst, cameraUnfit } = strings.byHand;
  const { online, unfit = null } = bench.camera;
  return [
    ...unplugged(bench, asked).map((axis) => plugFirst(strings.axis.short[axis])),
    ...(asked.kind !== "homing" && !online ? [cameraFirst] : []),
    ...(asked.kind !== "homing" && unfit !== null ? [cameraUnfit(unfit)] : []),
  ];
}

/** Why a job cannot begin, and what to do first, in words. */
export function barred(bench: Bench, asked: Asked): string[] {
  const { leaveFirst, homeFirst, airFirst } = strings.byHand;
  const { short } = strings.axis;
  const lost = unhomed(bench, asked);
  return [
    ...absent(bench, asked),
    ...switched(bench, asked).map((axis) => leaveFirst(short[axis])),
    ...(lost ? [homeFirst(short[lost])] : []),
    ...(asked.kind === "shell_only" && !bench.air_step_holds ? [airFirst] : []),
  ];
}
