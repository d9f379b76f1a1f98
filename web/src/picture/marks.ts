// What is marked in the picture to be measured: pure, in raw pixels.

import type { Size } from "./viewport";

export interface Place {
  x: number;
  y: number;
}

/** Whole pixels, at least one each way. */
export interface Region {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** From the middle of one pixel to that of another. */
export interface Ruler {
  from: Place;
  to: Place;
}

export interface Marks {
  /** Lines through the middle of the frame. */
  crosshair: boolean;
  region: Region | null;
  ruler: Ruler | null;
}

export const noMarks: Marks = { crosshair: false, region: null, ruler: null };

/** What a drag draws. */
export type Tool = "region" | "ruler";

const held = (value: number, least: number, most: number) => Math.min(Math.max(value, least), most);

function inside({ x, y }: Place, frame: Size): Place {
  return { x: held(x, 0, frame.width - 1), y: held(y, 0, frame.height - 1) };
}

/** With one pixel in one corner and another in the other. */
export function regionOf(one: Place, other: Place, frame: Size): Region {
  const [from, to] = [inside(one, frame), inside(other, frame)];
  return {
    x: Math.min(from.x, to.x),
    y: Math.min(from.y, to.y),
    width: Math.abs(to.x - from.x) + 1,
    height: Math.abs(to.y - from.y) + 1,
  };
}

export function rulerOf(from: Place, to: Place, frame: Size): Ruler {
  return { from: inside(from, frame), to: inside(to, frame) };
}

/** Moved by so many pixels, as far as it stays within the frame. */
export function movedRegion(region: Region, by: Place, frame: Size): Region {
  const x = held(region.x + by.x, 0, frame.width - region.width);
  return { ...region, x, y: held(region.y + by.y, 0, frame.height - region.height) };
}

/** With its lower right corner moved. */
export function resizedRegion(region: Region, by: Place, frame: Size): Region {
  const width = held(region.width + by.x, 1, frame.width - region.x);
  return { ...region, width, height: held(region.height + by.y, 1, frame.height - region.y) };
}

/** With one of its ends moved. */
export function movedRuler(ruler: Ruler, end: "from" | "to", by: Place, frame: Size): Ruler {
  const { x, y } = ruler[end];
  return { ...ruler, [end]: inside({ x: x + by.x, y: y + by.y }, frame) };
}

/** px. */
export function lengthOf({ from, to }: Ruler): number {
  return Math.hypot(to.x - from.x, to.y - from.y);
}

/** What of it is within a frame; itself where all of it is. */
export function fitting(marks: Marks, frame: Size): Marks {
  const { region, ruler } = marks;
  const [width, height] = [frame.width, frame.height];
  const kept =
    region && region.x + region.width <= width && region.y + region.height <= height ? region : null;
  const all = ruler ? [ruler.from, ruler.to] : [];
  const measured = all.every(({ x, y }) => x < width && y < height) ? ruler : null;
  return kept === region && measured === ruler ? marks : { ...marks, region: kept, ruler: measured };
}
