// What each kind of job takes: the rules are the daemon's, which has the last word.

import { numberOf } from "../words/number";
import { strings } from "../strings";
import { length, plain, typedMm, type LengthUnit } from "../words/units";
import type { Axis, AxisName, Design, JobKind, JobRequest } from "../daemon/wire";

/** A number that a kind takes. */
export interface NumberField {
  is: "number";
  name: "e_mm" | "distance_mm" | "from_mm" | "to_mm" | "steps" | "duration_s" | "interval_s";
  /** A length is typed in the unit chosen, and bounded and asked for in mm. */
  measure: "length" | "time" | "count";
  low: number;
  high: number;
  whole: boolean;
  needed: boolean;
}

/** One axis, or some of them. */
export type AxisField = { is: "axis"; name: "axis" } | { is: "axes"; name: "axes" };

export type Field = NumberField | AxisField;

const number = (
  name: NumberField["name"],
  measure: NumberField["measure"],
  low: number,
  high: number,
  more: Partial<Pick<NumberField, "whole" | "needed">> = {},
): NumberField => ({ is: "number", name, measure, low, high, whole: false, needed: false, ...more });

export const FIELDS: Record<JobKind, Field[]> = {
  joint_alignment: [],
  air_only: [],
  shell_only: [],
  clarity_only: [number("e_mm", "length", -1000, 1000)],
  l_bound_measurement: [],
  focus_sweep: [
    { is: "axis", name: "axis" },
    number("from_mm", "length", -1e4, 1e4, { needed: true }),
    number("to_mm", "length", -1e4, 1e4, { needed: true }),
    number("steps", "count", 2, 200, { whole: true }),
    number("distance_mm", "length", 1, 1e5),
  ],
  spacing_watch: [
    number("duration_s", "time", 1, 86_400, { needed: true }),
    number("interval_s", "time", 0.1, 3600),
  ],
  calibration: [number("distance_mm", "length", 1, 1e5)],
  homing: [{ is: "axes", name: "axes" }],
};

/** What is wrong with a draft, by the field. */
export type Faults = Partial<Record<Field["name"] | "note", string>>;

export const KINDS = Object.keys(FIELDS) as JobKind[];

/** Measurements of a spacing watch, at most. */
const MOST_MEASUREMENTS = 500;
const INTERVAL_S = 1;
/** Positions of a sweep unless given. */
const STEPS = 11;

/** What stands in a form: text as it was typed, the axes chosen. */
export interface Draft {
  kind: JobKind;
  note: string;
  /** Whether it is recorded; otherwise as the configuration has it. */
  record: boolean;
  numbers: Partial<Record<NumberField["name"], string>>;
  axis: AxisName;
  axes: AxisName[];
}

export function draftOf(kind: JobKind, note = "", record = false): Draft {
  return { kind, note, record, numbers: {}, axis: "focus", axes: ["focus", "e"] };
}

/** A request while its fields are being filled in. */
type Filled = {
  kind: JobKind;
  note?: string;
  record?: boolean;
  axis?: AxisName;
  axes?: AxisName[];
} & Partial<Record<NumberField["name"], number>>;

export type Checked = { ok: true; request: JobRequest } | { ok: false; faults: Faults };

/** The request that a form of such fields filled in with lengths of `unit` makes, or what is wrong with it, field by field. */
export function check(draft: Draft, fields: Field[], axes: Axis[], unit: LengthUnit): Checked {
  const faults: Faults = {};
  const request: Filled = { kind: draft.kind };
  if (draft.note.trim() !== "") request.note = draft.note.trim();
  if (draft.record) request.record = true;
  if (draft.note.length > 200) faults.note = strings.form.tooLong(200);
  for (const field of fields) {
    if (field.is === "axis") request.axis = draft.axis;
    else if (field.is === "axes") {
      if (draft.axes.length === 0) faults.axes = strings.form.axisNeeded;
      else request.axes = draft.axes;
    } else {
      const text = draft.numbers[field.name] ?? "";
      if (text.trim() === "") {
        if (field.needed) faults[field.name] = strings.form.needed;
        continue;
      }
      const read = numberOf(text);
      const value = field.measure === "length" && Number.isFinite(read) ? typedMm(read, unit) : read;
      const [low, high] = reach(field, draft, axes);
      if (!Number.isFinite(value)) faults[field.name] = strings.form.noNumber;
      else if (field.whole && !Number.isInteger(value)) faults[field.name] = strings.form.notWhole;
      else if (value < low || value > high) faults[field.name] = outside(field, low, high, unit);
      else request[field.name] = value;
    }
  }
  if (draft.kind === "spacing_watch" && request.duration_s) {
    const interval = request.interval_s ?? INTERVAL_S;
    const least = request.duration_s / MOST_MEASUREMENTS;
    if (interval < least && !faults.interval_s)
      faults.interval_s = strings.form.interval(MOST_MEASUREMENTS, least);
  }
  if (draft.kind === "focus_sweep" && request.from_mm !== undefined && request.from_mm === request.to_mm)
    faults.to_mm = strings.form.nowhere;
  // FIELDS has for each kind what its request has, which the compiler cannot follow.
  return Object.keys(faults).length > 0
    ? { ok: false, faults }
    : { ok: true, request: request as JobRequest };
}

function outside({ measure }: NumberField, low: number, high: number, unit: LengthUnit): string {
  if (measure === "length") return strings.form.outside(length(low, unit), length(high, unit));
  const spelt = (value: number) => (measure === "time" ? strings.form.seconds(value) : String(value));
  return strings.form.outside(spelt(low), spelt(high));
}

/** What the numbers of a form come to together, where that is more than they say one by one; null while one is missing. */
export function implied(draft: Draft, axes: Axis[], unit: LengthUnit): string | null {
  const checked = check(draft, FIELDS[draft.kind], axes, unit);
  if (!checked.ok) return null;
  const { request } = checked;
  switch (request.kind) {
    case "focus_sweep": {
      const positions = request.steps ?? STEPS;
      const apart = Math.abs(request.to_mm - request.from_mm) / (positions - 1);
      return strings.job.sweepMeans(positions, length(apart, unit, 4));
    }
    case "spacing_watch": {
      const interval = request.interval_s ?? INTERVAL_S;
      return strings.job.watchMeans(Math.floor(request.duration_s / interval) + 1);
    }
    default:
      return null;
  }
}

/** The axis whose travel a number is a place on. */
function along(name: NumberField["name"], draft: Draft): AxisName | null {
  if (name === "e_mm") return "e";
  return name === "from_mm" || name === "to_mm" ? draft.axis : null;
}

/** Where an axis is sent is where it may go. */
function reach(field: NumberField, draft: Draft, axes: Axis[]): [number, number] {
  const name = along(field.name, draft);
  const axis = axes.find((axis) => axis.axis === name);
  return axis ? [axis.low_limit_mm, axis.high_limit_mm] : [field.low, field.high];
}

/** What is taken where a field is left empty, as far as the page knows it. */
export function unless(name: NumberField["name"], design: Design | null, unit: LengthUnit): string {
  const tenths = (mm: number) => plain(Number(mm.toFixed(1)), unit);
  switch (name) {
    case "e_mm":
      return design ? tenths(design.clarity.e_mm) : "";
    case "distance_mm":
      return design ? tenths(design.joint.equivalent_distance_mm) : "";
    case "steps":
      return String(STEPS);
    case "interval_s":
      return String(INTERVAL_S);
    default:
      return "";
  }
}
