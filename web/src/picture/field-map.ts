// The spacing over the field as something to draw: which micro-images match which, and how each is tinted.

import type { FieldMap, Lens } from "../daemon/wire";

/** Neighbours are nearer to one another than this many pitches; the next but one are not. */
const NEAR_PITCHES = 1.25;

/** Neighbours that both match, each pair once. */
export function pairs(map: FieldMap): [Lens, Lens][] {
  const reach = NEAR_PITCHES * map.pitchPx;
  if (!(reach > 0)) return [];
  const cells = new Map<string, Lens[]>();
  const cell = (lens: Lens, dx = 0, dy = 0) =>
    `${Math.floor(lens.x / reach) + dx},${Math.floor(lens.y / reach) + dy}`;
  const matched = map.lenses.filter((lens) => lens.fate === "matched");
  for (const lens of matched) {
    const there = cells.get(cell(lens));
    if (there) there.push(lens);
    else cells.set(cell(lens), [lens]);
  }
  const found: [Lens, Lens][] = [];
  for (const lens of matched) {
    for (let dy = -1; dy <= 1; dy += 1) {
      for (let dx = -1; dx <= 1; dx += 1) {
        for (const other of cells.get(cell(lens, dx, dy)) ?? []) {
          // Each pair is met from both of its ends: taken from the one that comes first.
          if (other.y < lens.y || (other.y === lens.y && other.x <= lens.x)) continue;
          if (Math.hypot(other.x - lens.x, other.y - lens.y) <= reach) found.push([lens, other]);
        }
      }
    }
  }
  return found;
}

/** The distance from the target whose tint is the strongest, px: nearly all micro-images are within it. */
export function range(map: FieldMap): number {
  const apart = map.lenses
    .filter((lens) => lens.fate === "matched" && Number.isFinite(lens.spacingPx))
    .map((lens) => Math.abs(lens.spacingPx - map.targetPx))
    .sort((one, other) => one - other);
  return Math.max(LEAST_RANGE_PX, apart[Math.floor(apart.length * 0.95)] ?? 0);
}

const LEAST_RANGE_PX = 0.05;
/** Below and above the target: told apart by every kind of colour vision. */
export const BELOW = [40, 110, 255] as const;
export const ABOVE = [255, 140, 0] as const;
const STRONGEST = 0.65;

/** Colour of a micro-image; null where it has none. Paler where its own uncertainty is as large as its error. */
export function tint(lens: Lens, targetPx: number, rangePx: number): string | null {
  if (lens.fate !== "matched" || !Number.isFinite(lens.spacingPx)) return null;
  const error = (lens.spacingPx - targetPx) / rangePx;
  const size = Math.abs(error);
  const doubt = lens.sigmaPx / rangePx;
  const certainty = size > 0 ? size / (size + doubt) : 0;
  const strength = STRONGEST * Math.min(1, size) * certainty;
  if (!(strength > 0.01)) return null;
  return `rgb(${(error < 0 ? BELOW : ABOVE).join(" ")} / ${strength.toFixed(3)})`;
}
