// The axis of time that the live charts have in common.

import type uPlot from "uplot";
import { strings } from "../../strings";
import { TICKS_S } from "../../charts/stretch";
import { scaleAxis, type Options, type Theme } from "../plot";

/** What the charts show, in their own time: they are told of another stretch with their data. */
export interface Shown {
  /** As they are drawn: since the day began, s, so that ticks are at round times. */
  from: number;
  to: number;
  /** Ticks say how long ago, and not when. */
  ago: boolean;
}

export function base(
  colours: Theme,
  shown: () => Shown,
): Pick<Options, "scales" | "legend" | "cursor"> & { x: uPlot.Axis } {
  return {
    scales: { x: { time: false, range: () => [shown().from, shown().to] } },
    legend: { show: false },
    cursor: { show: true, drag: { x: false, y: false } },
    x: {
      ...scaleAxis(colours),
      // A time of day is long.
      space: () => (shown().ago ? 50 : 76) * colours.scale,
      incrs: TICKS_S,
      splits: (_plot, _axis, from, to, step) => ticks(from, to, step, shown().ago ? to : 0),
      values: (_plot, ticks, _axis, _space, step) =>
        ticks.map((tick) =>
          shown().ago ? strings.charts.ago(Math.round(shown().to - tick)) : timeOfDay(tick, step),
        ),
    },
  };
}

/** Every so many seconds from a time on that is one of them. */
function ticks(from: number, to: number, step: number, about: number): number[] {
  const all: number[] = [];
  for (let n = Math.ceil((from - about) / step - 1e-6); about + n * step <= to + 1e-6; n += 1)
    all.push(about + n * step);
  return all;
}

/** A time since the day began, s, as a clock has it: with seconds where ticks are that near, and tenths. */
export function timeOfDay(atS: number, stepS: number): string {
  const tenths = Math.round(atS * 10);
  const part = (per: number, of: number) => {
    const count = Math.floor(tenths / (10 * per));
    return String(((count % of) + of) % of).padStart(2, "0");
  };
  const minute = `${part(3600, 24)}:${part(60, 60)}`;
  if (stepS >= 60) return minute;
  return `${minute}:${part(1, 60)}${stepS < 1 ? `.${((tenths % 10) + 10) % 10}` : ""}`;
}
