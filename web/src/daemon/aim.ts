// What is asked for of the raw frame: the part that is seen, at as many pixels as the screen has for it. Pure, so that it
// can be tested.

import type { Size, Viewport } from "../picture/viewport";
import type { Part } from "./wire";

/** The whole frame, so coarse; or a part of it. */
export type Aim = { reduce: 1 | 2 | 4 } | { viewport: Part };

/** Before it is known how large the frame is. */
export const COARSE: Aim = { reduce: 4 };
/** Every pixel of the frame. */
export const EVERY = { reduce: 1 } as const;

/** From so many pixels of the screen to a raw one, single pixels are seen as such: they are to be the sensor's own. */
export const SINGLE = 2;

/** The part of a frame that is seen in a view. */
export function partSeen({ scale, left, top }: Viewport, view: Size, frame: Size): Part {
  const along = (offset: number, seen: number, there: number): [number, number] => {
    const from = Math.min(Math.max(0, Math.floor(-offset / scale)), there - 1);
    const to = Math.min(Math.max(Math.ceil((seen - offset) / scale), from + 1), there);
    return [from, to - from];
  };
  const room = (pixels: number) => Math.min(Math.max(1, Math.round(pixels * scale)), pixels);
  const [x_px, width_px] = along(left, view.width, frame.width);
  const [y_px, height_px] = along(top, view.height, frame.height);
  return {
    x_px,
    y_px,
    width_px,
    height_px,
    picture_width_px: room(width_px),
    picture_height_px: room(height_px),
    lossless: scale >= SINGLE,
  };
}

export function sameAim(one: Aim, other: Aim): boolean {
  if ("reduce" in one || "reduce" in other) {
    return "reduce" in one && "reduce" in other && one.reduce === other.reduce;
  }
  return samePart(one.viewport, other.viewport);
}

function samePart(one: Part, other: Part): boolean {
  return (
    one.x_px === other.x_px &&
    one.y_px === other.y_px &&
    one.width_px === other.width_px &&
    one.height_px === other.height_px &&
    one.picture_width_px === other.picture_width_px &&
    one.picture_height_px === other.picture_height_px &&
    one.lossless === other.lossless
  );
}

/** The whole frame in place of what cannot be had: no coarser than that would have been, where it comes so coarse. */
export function instead(aim: Aim): Aim {
  if ("reduce" in aim) return aim;
  const { width_px, height_px, picture_width_px, picture_height_px } = aim.viewport;
  const most = Math.min(width_px / picture_width_px, height_px / picture_height_px);
  return { reduce: most >= 4 ? 4 : most >= 2 ? 2 : 1 };
}
