// Marks over the picture, drawn in raw pixels: bright on dark, so that they are seen on anything.

import type { Marks, Place } from "./marks";
import type { Context } from "./overlay";
import type { Size } from "./viewport";

const MARK = "#ffe14d";
const SHADE = "#000000c0";
/** The arms at a ruler's ends, in widths of a line. */
const ARM = 6;

/** Places count from the middle of the first pixel. */
export function drawMarks(context: Context, { crosshair, region, ruler }: Marks, frame: Size): void {
  const width = context.lineWidth;
  const path = (lines: [Place, Place][]) => {
    context.setLineDash([]);
    context.beginPath();
    for (const [from, to] of lines) {
      context.moveTo(from.x, from.y);
      context.lineTo(to.x, to.y);
    }
    strokeOn(context, width);
  };
  if (crosshair) {
    const [x, y] = [(frame.width - 1) / 2, (frame.height - 1) / 2];
    path([
      [
        { x: -0.5, y },
        { x: frame.width - 0.5, y },
      ],
      [
        { x, y: -0.5 },
        { x, y: frame.height - 0.5 },
      ],
    ]);
  }
  if (region) {
    context.setLineDash([]);
    context.beginPath();
    context.rect(region.x - 0.5, region.y - 0.5, region.width, region.height);
    strokeOn(context, width);
  }
  if (ruler) {
    const { from, to } = ruler;
    const length = Math.hypot(to.x - from.x, to.y - from.y) || 1;
    const [dx, dy] = [to.x - from.x, to.y - from.y].map((part) => (part / length) * ARM * width) as [
      number,
      number,
    ];
    const arm = ({ x, y }: Place): [Place, Place] => [
      { x: x - dy, y: y + dx },
      { x: x + dy, y: y - dx },
    ];
    path([[from, to], arm(from), arm(to)]);
  }
}

function strokeOn(context: Context, width: number): void {
  for (const [colour, wide] of [
    [SHADE, 3 * width],
    [MARK, width],
  ] as const) {
    context.strokeStyle = colour;
    context.lineWidth = wide;
    context.stroke();
  }
  context.lineWidth = width;
}
