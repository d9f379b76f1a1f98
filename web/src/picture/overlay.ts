// What is laid over the picture, drawn in raw pixels.

import { range, tint } from "./field-map";
import type { Line } from "./field-surface";
import type { FieldMap, Lens } from "../daemon/wire";

export type Context = CanvasRenderingContext2D | OffscreenCanvasRenderingContext2D;

const GRID = "#5ad2c0";
const CROSS = "#ff4fd0";
const PAIR = "#ffffff";
const SHADE = "#000000b0";
const TARGET = "#ffffff";
const LINE_BELOW = "#8ab6ff";
const LINE_ABOVE = "#ffc46b";

function disc(context: Context, lens: Lens, radius: number): void {
  context.moveTo(lens.x + radius, lens.y);
  context.arc(lens.x, lens.y, radius, 0, 2 * Math.PI);
}

export function drawError(context: Context, map: FieldMap): void {
  const rangePx = range(map);
  for (const lens of map.lenses) {
    const colour = tint(lens, map.targetPx, rangePx);
    if (colour === null) continue;
    context.fillStyle = colour;
    context.beginPath();
    disc(context, lens, 0.48 * map.pitchPx);
    context.fill();
  }
}

/** Lines of equal spacing, that of the target stronger. */
export function drawLines(context: Context, lines: Line[]): void {
  const width = context.lineWidth;
  for (const { errorPx, pieces } of lines) {
    context.beginPath();
    for (const [x1, y1, x2, y2] of pieces) {
      context.moveTo(x1, y1);
      context.lineTo(x2, y2);
    }
    const own = (errorPx === 0 ? 3 : 1.5) * width;
    // Seen on what is bright, too.
    for (const [colour, more] of [
      [SHADE, 2 * width],
      [errorPx === 0 ? TARGET : errorPx < 0 ? LINE_BELOW : LINE_ABOVE, 0],
    ] as const) {
      context.strokeStyle = colour;
      context.lineWidth = own + more;
      context.stroke();
    }
  }
  context.lineWidth = width;
}

export function drawPairs(context: Context, links: [Lens, Lens][]): void {
  context.strokeStyle = PAIR;
  context.beginPath();
  for (const [from, to] of links) {
    const at = (share: number): [number, number] => [
      from.x + share * (to.x - from.x),
      from.y + share * (to.y - from.y),
    ];
    context.moveTo(...at(0.38));
    context.lineTo(...at(0.62));
  }
  context.stroke();
}

export function drawGrid(context: Context, map: FieldMap): void {
  const radius = 0.46 * map.pitchPx;
  const ring = (fate: Lens["fate"], colour: string, dash: number[]) => {
    context.setLineDash(dash);
    context.strokeStyle = colour;
    context.beginPath();
    for (const lens of map.lenses) if (lens.fate === fate) disc(context, lens, radius);
    context.stroke();
  };
  ring("matched", GRID, []);
  ring("blank", GRID, [radius / 4, radius / 4]);
  ring("mismatched", CROSS, []);
  context.beginPath();
  for (const lens of map.lenses) {
    if (lens.fate !== "mismatched") continue;
    const arm = 0.6 * radius;
    context.moveTo(lens.x - arm, lens.y - arm);
    context.lineTo(lens.x + arm, lens.y + arm);
    context.moveTo(lens.x - arm, lens.y + arm);
    context.lineTo(lens.x + arm, lens.y - arm);
  }
  context.stroke();
}
