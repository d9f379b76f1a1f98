// What a spacing means in millimetres, by the design's own figures: how far Δv or e would have to go, and how large a
// tilt is. The daemon decides moves by better models; this is for whoever turns a screw.

import type { Reading } from "./reading";
import type { Design } from "./wire";

/** A MLA in the terms of Eq. 9. */
interface Array {
  /** Pitch of the microlenses on the sensor, px. */
  pitchPx: number;
  /** Signed distance from the MLA to the main lens's image in focus, mm: negative in Keplerian mode. */
  aMm: number;
  bMm: number;
  pixelMm: number;
}

export interface Correction {
  /** By how much Δv has to grow, mm. */
  deltaVMm: number;
  /** Its standard uncertainty, mm. */
  sigmaMm: number;
  /** By how much e would have to grow instead, mm; null where the design says nothing of it. */
  eMm: number | null;
  /** Its standard uncertainty, mm. */
  eSigmaMm: number | null;
}

export interface Tilt {
  /** Angle between lens and MLA if nothing else were tilted, degrees. */
  degrees: number;
  /** Its standard uncertainty, degrees. */
  sigmaDegrees: number;
  /** Where the spacing grows, radians from the picture's right, clockwise as seen. */
  towards: number;
}

/** Δv corrections beyond this are no measurement any more, mm. */
const FURTHEST_MM = 20;

/** The design reports a without its sign; which mode it is shows in the pitch of the micro-images. */
function arrayOf(design: Design, microImagePitchPx: number): Array | null {
  const { a_mm: a, b_mm: b, f_number } = design.mla;
  const target = design.spacing_target_px;
  const modes = [a, -a].map((aMm) => ({ aMm, pitchPx: (target * aMm) / (aMm - b) }));
  const near = (mode: { pitchPx: number }) => Math.abs(mode.pitchPx - microImagePitchPx);
  const usable = modes.filter((mode) => mode.pitchPx > 0 && Number.isFinite(mode.pitchPx));
  const mode = usable.sort((one, other) => near(one) - near(other))[0];
  if (!mode || !(b > 0) || !(f_number > 0)) return null;
  return { ...mode, bMm: b, pixelMm: b / f_number / mode.pitchPx };
}

/** Eq. 9: where the image is for a spacing, mm from the MLA. */
function imageAt(array: Array, spacingPx: number): number {
  return (array.pitchPx * array.bMm) / (array.pitchPx - spacingPx);
}

/** How far Δv or e has to go until the spacing measured is the one wanted; null where it is too far to be told. */
export function correction(design: Design | null, reading: Reading | null): Correction | null {
  if (!design || !reading || reading.pitchPx === null) return null;
  const array = arrayOf(design, reading.pitchPx);
  if (!array) return null;
  const spacing = reading.spacingPx;
  // The MLA is carried along: a grows by as much as Δv shrinks.
  const deltaVMm = imageAt(array, spacing) - imageAt(array, reading.targetPx);
  const apart = array.pitchPx - spacing;
  const sigmaMm = ((array.pitchPx * array.bMm) / (apart * apart)) * reading.sigmaPx;
  if (!(Math.abs(deltaVMm) <= FURTHEST_MM) || !Number.isFinite(sigmaMm)) return null;
  // Δv in focus as e grows, from the design's two solutions.
  const { joint, clarity } = design;
  const slope = (joint.delta_v_mm - clarity.delta_v_mm) / (joint.e_mm - clarity.e_mm);
  const usable = Number.isFinite(slope) && Math.abs(slope) > 1e-9;
  return {
    deltaVMm,
    sigmaMm,
    eMm: usable ? -deltaVMm / slope : null,
    eSigmaMm: usable ? Math.abs(sigmaMm / slope) : null,
  };
}

/** The tilt that a spacing's change over the field would be, for a frame `widthPx` wide. */
export function tilt(design: Design | null, reading: Reading | null, widthPx: number): Tilt | null {
  if (!design || !reading || reading.pitchPx === null || !(widthPx > 0)) return null;
  const array = arrayOf(design, reading.pitchPx);
  if (!array) return null;
  const { tiltXPx: x, tiltYPx: y } = reading;
  const slopePxPerMm = (array.pitchPx * array.bMm) / (array.aMm * array.aMm);
  const halfWidthMm = (widthPx / 2) * array.pixelMm;
  const degrees = (px: number) => (Math.atan(px / slopePxPerMm / halfWidthMm) * 180) / Math.PI;
  // A slope over an evenly filled field, at its edge, is √3 times as uncertain as the mean.
  const sigmaPx = Math.sqrt(3) * reading.single.sigmaPx;
  return { degrees: degrees(Math.hypot(x, y)), sigmaDegrees: degrees(sigmaPx), towards: Math.atan2(y, x) };
}

const OCTANTS = [
  "right",
  "lowerRight",
  "bottom",
  "lowerLeft",
  "left",
  "upperLeft",
  "top",
  "upperRight",
] as const;
export type Octant = (typeof OCTANTS)[number];

/** A direction in the picture by its name. */
export function octant(towards: number): Octant {
  const eighth = Math.round(towards / (Math.PI / 4));
  return OCTANTS[((eighth % 8) + 8) % 8] ?? "right";
}
