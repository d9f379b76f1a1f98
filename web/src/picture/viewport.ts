// Which part of a raw frame is seen, and how large: pure, so that zooming can be tested.

export interface Size {
  width: number;
  height: number;
}

/** A raw pixel (x, y) is drawn at (left + x · scale, top + y · scale), in pixels of the view. */
export interface Viewport {
  scale: number;
  left: number;
  top: number;
}

/** Pixels of the view to a raw pixel at most. */
const LARGEST = 48;

/** The whole frame, in the middle. */
export function fit(view: Size, frame: Size): Viewport {
  const scale = Math.min(view.width / frame.width, view.height / frame.height);
  return centred({ scale, left: 0, top: 0 }, view, frame);
}

/** The frame is kept in sight: in the middle where it is smaller than the view, without a gap where it is larger. */
function centred(viewport: Viewport, view: Size, frame: Size): Viewport {
  const along = (offset: number, seen: number, there: number) =>
    there <= seen ? (seen - there) / 2 : Math.min(0, Math.max(seen - there, offset));
  return {
    scale: viewport.scale,
    left: along(viewport.left, view.width, frame.width * viewport.scale),
    top: along(viewport.top, view.height, frame.height * viewport.scale),
  };
}

/** Larger by `factor` about a point of the view, which stays where it is. */
export function zoom(
  viewport: Viewport,
  factor: number,
  about: { x: number; y: number },
  view: Size,
  frame: Size,
): Viewport {
  const least = fit(view, frame).scale;
  const scale = Math.min(Math.max(viewport.scale * factor, least), Math.max(LARGEST, least));
  const grown = scale / viewport.scale;
  return centred(
    {
      scale,
      left: about.x - (about.x - viewport.left) * grown,
      top: about.y - (about.y - viewport.top) * grown,
    },
    view,
    frame,
  );
}

/** Moved by so many pixels of the view. */
export function pan(viewport: Viewport, dx: number, dy: number, view: Size, frame: Size): Viewport {
  return centred({ scale: viewport.scale, left: viewport.left + dx, top: viewport.top + dy }, view, frame);
}

/** The raw pixel under a point of the view; null outside the frame. */
export function pixelAt(
  viewport: Viewport,
  at: { x: number; y: number },
  frame: Size,
): { x: number; y: number } | null {
  const x = Math.floor((at.x - viewport.left) / viewport.scale);
  const y = Math.floor((at.y - viewport.top) / viewport.scale);
  return x >= 0 && y >= 0 && x < frame.width && y < frame.height ? { x, y } : null;
}

/** Whether nothing is cut off. */
export function isWhole(viewport: Viewport, view: Size, frame: Size): boolean {
  return viewport.scale <= fit(view, frame).scale * 1.001;
}
