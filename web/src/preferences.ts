// What this browser remembers for whoever uses it. It is about the page alone: the bench has its own configuration.

import { LANGUAGE_CHOICES, type LanguageChoice } from "./words/language";
import { SHOWS } from "./picture/show";
import { SPACE, type StopKey } from "./bench/stop-key";
import { UNITS, type LengthUnit } from "./words/units";

/** What can be drawn over the picture. */
export const OVERLAYS = ["grid", "pairs", "error", "saturation"] as const;
export type Overlay = (typeof OVERLAYS)[number];

export interface Preferences {
  /** What others are shown as the lease's owner; empty for the name one signed in with, null before it was asked for. */
  name: string | null;
  language: LanguageChoice;
  stopKey: StopKey;
  unit: LengthUnit;
  overlays: Overlay[];
  /** What the live picture shows. */
  show: (typeof SHOWS)[number];
  /** Step of the step buttons, mm. */
  stepMm: number;
  /** Whether a sound calls the operator whose turn it is. */
  call: boolean;
  /** Whether the screen is kept awake. */
  awake: boolean;
}

export const standard: Preferences = {
  name: null,
  language: "browser",
  stopKey: SPACE,
  unit: "mm",
  overlays: [],
  show: "raw",
  stepMm: 0.1,
  call: true,
  awake: false,
};

export const STEPS_MM = [0.01, 0.1, 1] as const;

const KEY = "plenalign.preferences";

function text(value: unknown): value is string {
  return typeof value === "string";
}

/** Preferences as they were kept; whatever cannot be read is as standard. */
export function recall(storage: Pick<Storage, "getItem">): Preferences {
  let kept: Record<string, unknown>;
  try {
    kept = (JSON.parse(storage.getItem(KEY) ?? "{}") ?? {}) as Record<string, unknown>;
  } catch {
    return standard;
  }
  const key = kept["stopKey"] as Partial<StopKey> | undefined;
  const overlays = kept["overlays"];
  return {
    name: text(kept["name"]) ? kept["name"].slice(0, 64) : standard.name,
    language: LANGUAGE_CHOICES.find((choice) => choice === kept["language"]) ?? standard.language,
    stopKey:
      key && text(key.code) && key.code !== "" && text(key.name) ? { code: key.code, name: key.name } : SPACE,
    unit: UNITS.find((unit) => unit === kept["unit"]) ?? standard.unit,
    overlays: Array.isArray(overlays) ? OVERLAYS.filter((overlay) => overlays.includes(overlay)) : [],
    show: SHOWS.find((show) => show === kept["show"]) ?? standard.show,
    stepMm: STEPS_MM.find((step) => step === kept["stepMm"]) ?? standard.stepMm,
    call: typeof kept["call"] === "boolean" ? kept["call"] : standard.call,
    awake: typeof kept["awake"] === "boolean" ? kept["awake"] : standard.awake,
  };
}

/** The preferences of a tab that has been given no name, with the one that another tab of the browser has. */
export function named(mine: Preferences, kept: Preferences): Preferences {
  return mine.name === null && kept.name !== null ? { ...mine, name: kept.name } : mine;
}

/** Keeps what has been changed since `before`: another tab of the browser may have kept something else meanwhile. */
export function keep(
  storage: Pick<Storage, "getItem" | "setItem">,
  preferences: Preferences,
  before: Preferences,
): void {
  const changed = Object.entries(preferences).filter(
    ([name, value]) => value !== before[name as keyof Preferences],
  );
  try {
    const kept = { ...recall(storage), ...Object.fromEntries(changed) };
    storage.setItem(KEY, JSON.stringify(kept));
  } catch {
    // A browser that keeps nothing works all the same, until it is closed.
  }
}
