// Words of what is measured in the live picture, and kept of it.

import type { Tool } from "../../picture/marks";

export const measuring = {
  title: "Measure",
  crosshair: "Crosshair",
  crosshairMore: "Lines through the middle of the frame",
  tool: {
    region: "Region",
    ruler: "Distance",
  } satisfies Record<Tool, string>,
  toolMore: {
    region: "Spacing and brightness of a part: drag over it",
    ruler: "Between two pixels: drag from one to the other",
  } satisfies Record<Tool, string>,
  keys: {
    region:
      "Dragging draws a region. Arrows move it, with Shift its lower right corner; Escape ends. Plus and minus zoom, 0 shows all of the picture.",
    ruler:
      "Dragging draws a distance. Arrows move its end, with Shift its beginning; Escape ends. Plus and minus zoom, 0 shows all of the picture.",
  } satisfies Record<Tool, string>,
  region: (width: number, height: number, x: number, y: number) =>
    `Region of ${width} × ${height} px at ${x}, ${y}`,
  spacing: (spacing: string, sigma: string) => `spacing ${spacing} ± ${sigma} px by noise and scatter alone`,
  difference: (difference: string) => `${difference} px from the target`,
  spacingMore:
    "Mean over its micro-images, with what noise and scatter about a smooth surface leave uncertain: regions of a frame compare among themselves by it; what the whole frame has in common is in the meter's ± alone",
  of: (lenses: number, frame: number) => `${lenses} micro-images of frame ${frame}`,
  old: "OLD",
  spacingNone: "no spacing: too few micro-images measured in it",
  grey: (mean: string, least: number, most: number) => `grey ${mean} on average, ${least} to ${most} of 255`,
  saturated: (percent: string) => `${percent} % saturated`,
  greyNone: "grey levels come with the next picture",
  distance: (px: string) => `Distance ${px} px`,
  lenses: (count: string) => `${count} micro-images`,
  along: (dx: string, dy: string) => `${dx} across, ${dy} down`,
  keep: "Keep",
  snapshot: "Snapshot",
  snapshotMore: "The picture as it is seen here, with what is laid over it",
  raw: "Raw file",
  rawMore: "The newest frame with the camera's own samples, every bit of them",
  full: "Large",
  fullMore: "The picture alone, on all of the screen where the browser has that",
  nothing: "There is no picture to keep yet",
};
