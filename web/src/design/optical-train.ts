// The optical train as lines in a plane: what its drawing is made of. All in mm; the drawing's x runs from the object on
// the left to the sensor on the right, so that it is the axis turned round, with 0 at the main lens.

import type { DraftState } from "../daemon/wire";

export const PARTS = ["camera", "scene", "mla"] as const;
export type Part = (typeof PARTS)[number];

export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** What of the configuration the drawing needs. */
export interface Parts {
  outerRadius: number;
  innerRadius: number;
  pitch: number;
  b: number;
  sensorWidth: number;
  /** From the shell in water, from the lens in air. */
  objectDistance: number;
}

export interface Train {
  /** C, or null in air. */
  centre: number | null;
  outerRadius: number;
  innerRadius: number;
  mla: number;
  sensor: number;
  object: number;
  aperture: number;
  sensorWidth: number;
  boardWidth: number | null;
  pitch: number;
  rays: { field: number; points: string }[];
}

export function trainOf(state: DraftState, parts: Parts): Train {
  const e = state.e_mm ?? null;
  const object = e === null ? parts.objectDistance : e + parts.outerRadius + parts.objectDistance;
  return {
    centre: e === null ? null : turned(e),
    outerRadius: parts.outerRadius,
    innerRadius: parts.innerRadius,
    mla: state.lens_to_mla_mm,
    sensor: state.lens_to_mla_mm + parts.b,
    object: turned(object),
    aperture: state.aperture_mm,
    sensorWidth: parts.sensorWidth,
    boardWidth: state.board_width_mm ?? null,
    pitch: parts.pitch,
    rays: state.rays.map(({ field, points_mm }) => ({
      field,
      points: points_mm.map(([along = 0, beside = 0]) => `${turned(along)},${turned(beside)}`).join(" "),
    })),
  };
}

/** Without a negative zero. */
function turned(value: number): number {
  return value === 0 ? 0 : -value;
}

/** What of the drawing is seen. */
export function boxOf(train: Train, part: Part): Box {
  if (part === "mla") {
    const width = 2.4 * (train.sensor - train.mla);
    const height = Math.max(6 * train.pitch, width / 2);
    return { x: (train.mla + train.sensor) / 2 - width / 2, y: -height / 2, width, height };
  }
  const right = train.sensor + (part === "scene" ? 30 : 6);
  // In air there is no shell: as much is seen as with one at the lens.
  const shell = train.centre === null ? -train.outerRadius : train.centre - train.outerRadius;
  const left = part === "scene" ? train.object - 30 : shell - 8;
  const half =
    part === "scene"
      ? Math.max((train.boardWidth ?? 0) / 2, train.outerRadius) * 1.1
      : Math.max(train.aperture, train.sensorWidth) * 1.8;
  return { x: left, y: -half, width: right - left, height: 2 * half };
}

/** A box of the proportions of where it is shown: more of the water on the left, or as much above as below. */
export function fitted(box: Box, aspect: number): Box {
  const width = Math.max(box.width, box.height * aspect);
  const height = Math.max(box.height, box.width / aspect);
  return { x: box.x + box.width - width, y: -height / 2, width, height };
}

/** The part of a shell towards the water, from its rim's one side to the other: a half circle of a radius about C. */
export function hemisphere(centre: number, radius: number): string {
  return `M${centre} ${-radius}A${radius} ${radius} 0 0 0 ${centre} ${radius}`;
}

/** A length for a scale bar, mm: the largest of 1, 2 or 5 times a power of ten that is at most a quarter of the width. */
export function barLength(width: number): number {
  const most = width / 4;
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((factor) => factor * power).find((length) => length <= most) ?? power;
}
