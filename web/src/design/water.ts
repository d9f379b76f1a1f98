// The water of a draft: an index given, or the conditions that it follows from.

import type { Json, JsonObject } from "./config-schema";

/** Sections of the configuration with some of their keys. */
export type Sections = Record<string, JsonObject>;

export function keyed(value: Json | undefined): value is JsonObject {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

export type WaterBy = "index" | "conditions";

/** Clear water in a laboratory's tank. */
const FRESH: JsonObject = { temperature_c: 20, salinity_permille: 0, wavelength_nm: 550 };

export function waterBy(water: Json | undefined): WaterBy {
  return keyed(water) && "refractive_index" in water && water["refractive_index"] !== null
    ? "index"
    : "conditions";
}

/** The water said the other way: with the index that it has had, or under conditions to be edited. */
export function waterSaid(by: WaterBy, index: number): JsonObject {
  return by === "index" ? { refractive_index: Number(index.toFixed(6)) } : FRESH;
}
