// The scale of charts of the spacing less its target: a pixel is shown beside a hundredth of one, as on the meter.

import type uPlot from "uplot";
import { fixed } from "../words/format";
import { scaleAxis, type Theme } from "./plot";

/** The scale is linear within this distance from the target and logarithmic beyond, px. */
const LINEAR_PX = 0.02;
/** It shows this much on either side of the target at least, px. */
const LEAST_PX = 0.1;
const MARGIN = 1.5;
const MARKS_PX = [-100, -10, -1, -0.1, 0, 0.1, 1, 10, 100];

export const differenceScale: uPlot.Scale = {
  distr: 4,
  asinh: LINEAR_PX,
  range: (_plot, low, high) => [
    Math.min(-LEAST_PX, MARGIN * (low ?? 0)),
    Math.max(LEAST_PX, MARGIN * (high ?? 0)),
  ],
};

export function differenceAxis(colours: Theme, label: string): uPlot.Axis {
  return {
    ...scaleAxis(colours, label),
    splits: (_plot, _axis, low, high) => MARKS_PX.filter((mark) => mark >= low && mark <= high),
    filter: (_plot, splits) => splits,
    values: (_plot, splits) => splits.map((mark) => fixed(mark, Number.isInteger(mark) ? 0 : 1)),
  };
}
