// A draft of a camera: which of its values can be edited, what is asked of the daemon for them, what is written.

import { same, valueAt, withValue, type Json, type JsonObject } from "./config-schema";
import { numberOf } from "../words/number";
import { keyed, type Sections } from "./water";
import { angle, plain, typedMm, type LengthUnit } from "../words/units";

/** What a value is measured in: a length follows the unit chosen; the rest stays as it is. */
export type Measure = "length" | "pixel" | "count" | "plain" | "celsius" | "permille" | "nanometre" | "blur";

export type DraftField =
  { path: string; is: "number"; measure: Measure } | { path: string; is: "choice"; of: readonly string[] };

export interface FieldGroup {
  name: "main_lens" | "mla" | "sensor" | "shell" | "object" | "assembly";
  fields: DraftField[];
}

const number = (path: string, measure: Measure): DraftField => ({ path, is: "number", measure });

/** What can be edited, section by section; the water is chosen among alternatives, elsewhere. */
export const GROUPS: FieldGroup[] = [
  { name: "main_lens", fields: [number("main_lens.focal_length_mm", "length")] },
  {
    name: "shell",
    fields: [
      number("shell.outer_radius_mm", "length"),
      number("shell.inner_radius_mm", "length"),
      number("shell.refractive_index", "plain"),
    ],
  },
  {
    name: "mla",
    fields: [
      { path: "mla.mode", is: "choice", of: ["galilean", "keplerian"] },
      { path: "mla.array", is: "choice", of: ["square", "hexagonal"] },
      number("mla.pitch_mm", "length"),
      number("mla.focal_length_mm", "length"),
      number("mla.angular_resolution", "plain"),
    ],
  },
  {
    name: "sensor",
    fields: [
      number("sensor.pixel_um", "pixel"),
      number("sensor.width_px", "count"),
      number("sensor.height_px", "count"),
    ],
  },
  {
    name: "object",
    fields: [number("object.distance_mm", "length"), number("object.air_distance_mm", "length")],
  },
  {
    name: "assembly",
    fields: [
      number("assembly.initial_e_mm", "length"),
      number("assembly.l_bound_mm", "length"),
      number("assembly.blur_limit_px", "blur"),
    ],
  },
];

/** A value as it is typed. */
export function spelt(value: Json | undefined, measure: Measure, unit: LengthUnit): string {
  if (typeof value !== "number") return typeof value === "string" ? value : "";
  return measure === "length" ? plain(value, unit) : String(value);
}

/** What is typed, as the configuration has it; what is no number goes on as text, for the daemon to name it. */
export function typed(text: string, measure: Measure, unit: LengthUnit): Json {
  const value = numberOf(text);
  if (!Number.isFinite(value)) return text;
  return measure === "length" ? typedMm(value, unit) : value;
}

/** The sections of `to` with the keys that differ from `from`; the water whole, its keys being alternatives. */
export function difference(from: JsonObject, to: JsonObject): Sections {
  const sections: Sections = {};
  for (const [section, keys] of Object.entries(to)) {
    const before = from[section];
    if (!keyed(keys) || same(before, keys)) continue;
    const other = Object.entries(keys).filter(
      ([key, value]) => section === "water" || !same(value, keyed(before) ? before[key] : undefined),
    );
    sections[section] = Object.fromEntries(other);
  }
  return sections;
}

/** The configuration's file, as it was when this page read it. */
export interface ConfigFile {
  /** Null where there is none, or none that can be read. */
  stored: JsonObject | null;
  etag: string | null;
  /** Why it cannot be read, in the daemon's words. */
  fault: string | null;
  /** Keys that take effect when the daemon starts again. */
  waiting: string[];
}

/** The camera that is edited: the one in force, with what waits in the file for the daemon's next start. */
export function awaited(inForce: JsonObject, file: ConfigFile | null): JsonObject {
  let next = inForce;
  for (const path of file?.waiting ?? []) {
    const [section = ""] = path.split(".");
    const of = section === "water" ? section : path;
    const value = valueAt(file?.stored ?? undefined, of);
    if (section in inForce && value !== undefined) next = withValue(next, of, value);
  }
  return next;
}

/** A configuration with the keys of a draft that differ from what is edited. */
export function laidOver(config: JsonObject, sections: Sections): JsonObject {
  let next = config;
  for (const [section, keys] of Object.entries(sections)) {
    if (section === "water") next = { ...next, water: keys };
    else for (const [key, value] of Object.entries(keys)) next = withValue(next, `${section}.${key}`, value);
  }
  return next;
}

/** A draft of one configuration as one of another: with each value that it changes, and all else as it is now; the water
 *  whole, its keys being alternatives. */
export function rebased(draft: JsonObject | null, from: JsonObject | null, to: JsonObject): JsonObject {
  return draft && from ? carriedOver(draft, from, to) : to;
}

function carriedOver(draft: JsonObject, from: JsonObject, to: JsonObject): JsonObject {
  const next = new Map(Object.entries(to));
  for (const key of new Set([...Object.keys(from), ...Object.keys(draft)])) {
    const [mine, before, now] = [draft[key], from[key], to[key]];
    if (same(mine, before)) continue;
    if (mine === undefined) next.delete(key);
    else if (key !== "water" && keyed(mine) && keyed(before) && keyed(now)) {
      next.set(key, carriedOver(mine, before, now));
    } else next.set(key, mine);
  }
  return Object.fromEntries(next);
}

/** Those of the paths that a draft changes and somebody else has changed meanwhile, to another value. */
export function overtaken(draft: JsonObject, from: JsonObject, to: JsonObject, paths: string[]): string[] {
  return paths.filter((path) => {
    const [mine, before, now] = [draft, from, to].map((config) => valueAt(config, path));
    return !same(mine, before) && !same(now, before) && !same(mine, now);
  });
}

/** How many keys a draft changes. */
export function count(sections: Sections): number {
  return Object.values(sections).reduce((sum, keys) => sum + Object.keys(keys).length, 0);
}

/** Whether a draft has another value. */
export function isChanged(from: JsonObject, to: JsonObject, path: string): boolean {
  return !same(valueAt(from, path), valueAt(to, path));
}

/** An angle in degrees. */
export function degrees(value: number | null | undefined): string | null {
  return typeof value === "number" ? angle(value, 2) : null;
}
