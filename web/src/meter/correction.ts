// What a spacing means in millimetres, by the design's own figures: how far Δv or e would have to go, and how large a
// tilt is. The daemon decides moves by better models; this is for whoever turns a screw.

import type { Reading } from "./reading";
import type { Design } from "../daemon/wire";

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
/** Nor are those of e beyond this: the design says nothing from there on. */
const FURTHEST_E_MM = 60;

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
  const inFocus = focusOverE(design, array);
  const from = reading.eMm ?? design.joint.e_mm;
  const eMm = inFocus && wayDown(inFocus, from, deltaVMm);
  const slope = inFocus && slopeAt(inFocus, from);
  return { deltaVMm, sigmaMm, eMm, eSigmaMm: eMm === null || !slope ? null : Math.abs(sigmaMm / slope) };
}

type Curve = (eMm: number) => number;

/** Δv in focus over e, through what the design has of it: its two solutions, and the e at which the joint one's Δv is off by
 *  the blur limit. A straight line through the solutions alone is a quarter too flat at the joint one. */
function focusOverE(
  { joint, clarity, e_tolerance, blur_limit_px, spacing_target_px }: Design,
  array: Array,
): Curve | null {
  const apart = joint.e_mm - clarity.e_mm;
  if (!(Math.abs(apart) > APART_MM) || !(Math.abs(joint.delta_v_mm - clarity.delta_v_mm) > 1e-9)) return null;
  // Which way the spacing goes as e does.
  const rising = (joint.delta_v_mm - clarity.delta_v_mm) / apart > 0 ? 1 : -1;
  const off = (px: number) => imageAt(array, spacing_target_px + px) - imageAt(array, spacing_target_px);
  const ends = [
    { e: e_tolerance?.low_mm, px: -rising * blur_limit_px },
    { e: e_tolerance?.high_mm, px: rising * blur_limit_px },
  ].flatMap(({ e, px }) => (typeof e === "number" ? [{ e, deltaV: joint.delta_v_mm + off(px) }] : []));
  const points = [joint, clarity].map(({ e_mm: e, delta_v_mm: deltaV }) => ({ e, deltaV }));
  const usable = ({ e, deltaV }: { e: number; deltaV: number }) =>
    Number.isFinite(deltaV) && points.every((point) => Math.abs(e - point.e) > APART_MM);
  return through([...points, ...ends.filter(usable)]);
}

/** Nearer to one another, two places say nothing of what is between them, mm. */
const APART_MM = 1;
/** What a slope is taken over, to either side, mm. */
const STEP_MM = 0.1;

/** The polynomial through some points. */
function through(points: { e: number; deltaV: number }[]): Curve {
  return (at) =>
    points.reduce((sum, point) => {
      const others = points.filter((other) => other !== point);
      return (
        sum + others.reduce((value, other) => (value * (at - other.e)) / (point.e - other.e), point.deltaV)
      );
    }, 0);
}

function slopeAt(curve: Curve, at: number): number {
  return (curve(at + STEP_MM) - curve(at - STEP_MM)) / (2 * STEP_MM);
}

/** How far it is on a curve to where it is lower by so much; null where that is nowhere near. */
function wayDown(curve: Curve, from: number, by: number): number | null {
  const wanted = curve(from) - by;
  let at = from;
  for (let step = 0; step < 20; step += 1) {
    const next = at + (wanted - curve(at)) / slopeAt(curve, at);
    if (!Number.isFinite(next) || Math.abs(next - from) > FURTHEST_E_MM) return null;
    if (Math.abs(next - at) < 1e-6) return next - from;
    at = next;
  }
  return null;
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
