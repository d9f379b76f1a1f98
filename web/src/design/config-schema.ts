// The configuration's JSON Schema as a tree of keys to be shown and edited. What is right is for the daemon to say: the
// schema only decides what each key is edited with.

/** A piece of JSON. */
export type Json = null | boolean | number | string | Json[] | { [key: string]: Json };
export type JsonObject = { [key: string]: Json };

export interface Choice {
  value: string;
  meaning: string;
}

/** What a key is edited with. */
export type Editor =
  | { by: "number"; whole: boolean }
  | { by: "text" }
  | { by: "switch" }
  | { by: "choice"; choices: Choice[] }
  /** Lists, tables with keys of one's own, and whatever else: as JSON. */
  | { by: "json" };

export interface Key {
  /** Dotted from the root. */
  path: string;
  name: string;
  meaning: string;
  standard: Json | undefined;
  editor: Editor;
}

/** A table of the configuration with its own keys, then its tables. */
export interface Table {
  path: string;
  name: string;
  meaning: string;
  keys: Key[];
  tables: Table[];
}

function isObject(value: unknown): value is JsonObject {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function text(value: Json | undefined): string {
  return typeof value === "string" ? value : "";
}

/** The schema as a tree of tables; null where it is none. */
export function tableOf(schema: unknown): Table | null {
  if (!isObject(schema)) return null;
  const definitions = isObject(schema["$defs"]) ? schema["$defs"] : {};
  return table("", "", schema, definitions, 0);
}

const DEEPEST = 8;

/** A `$ref` followed; what stands beside it goes before what it leads to. */
function resolved(node: JsonObject, definitions: JsonObject): JsonObject {
  const name = text(node["$ref"]).replace("#/$defs/", "");
  const found = definitions[name];
  return isObject(found) ? { ...found, ...node } : node;
}

function table(path: string, name: string, node: JsonObject, definitions: JsonObject, depth: number): Table {
  const made: Table = { path, name, meaning: text(node["description"]), keys: [], tables: [] };
  const properties = isObject(node["properties"]) ? node["properties"] : {};
  for (const [key, value] of Object.entries(properties)) {
    if (!isObject(value)) continue;
    const inner = resolved(value, definitions);
    const at = path === "" ? key : `${path}.${key}`;
    if (isObject(inner["properties"]) && depth < DEEPEST) {
      made.tables.push(table(at, key, inner, definitions, depth + 1));
    } else {
      made.keys.push({
        path: at,
        name: key,
        meaning: text(inner["description"]),
        standard: inner["default"],
        editor: editorOf(inner),
      });
    }
  }
  return made;
}

function editorOf(node: JsonObject): Editor {
  const type = Array.isArray(node["type"]) ? node["type"].find((one) => one !== "null") : node["type"];
  const choices = choicesOf(node);
  if (choices.length > 0) return { by: "choice", choices };
  if (type === "boolean") return { by: "switch" };
  if (type === "number" || type === "integer") return { by: "number", whole: type === "integer" };
  if (type === "string") return { by: "text" };
  return { by: "json" };
}

function choicesOf(node: JsonObject): Choice[] {
  const listed = Array.isArray(node["enum"])
    ? node["enum"].map((value): Json => ({ const: value }))
    : node["oneOf"];
  if (!Array.isArray(listed)) return [];
  const choices = listed.map((one) => {
    if (!isObject(one)) return [];
    if (typeof one["const"] === "string") return [{ value: one["const"], meaning: text(one["description"]) }];
    const values = Array.isArray(one["enum"]) ? one["enum"] : [];
    return values.every((value) => typeof value === "string")
      ? values.map((value) => ({ value, meaning: "" }))
      : [];
  });
  // One that is no word cannot be chosen from a list.
  return choices.some((some) => some.length === 0) ? [] : choices.flat();
}

/** The value at a dotted path. */
export function valueAt(config: Json | undefined, path: string): Json | undefined {
  let at: Json | undefined = config;
  for (const part of path.split(".")) {
    if (!isObject(at)) return undefined;
    at = at[part];
  }
  return at;
}

/** A copy with another value at a dotted path. */
export function withValue(config: JsonObject, path: string, value: Json): JsonObject {
  const [first, ...rest] = path.split(".");
  if (first === undefined) return config;
  if (rest.length === 0) return { ...config, [first]: value };
  const inner = config[first];
  return { ...config, [first]: withValue(isObject(inner) ? inner : {}, rest.join("."), value) };
}

/** The same keys with the same values, in whatever order. */
export function same(one: Json | undefined, other: Json | undefined): boolean {
  if (Array.isArray(one) && Array.isArray(other)) {
    return one.length === other.length && one.every((value, index) => same(value, other[index]));
  }
  if (isObject(one) && isObject(other)) {
    const keys = new Set([...Object.keys(one), ...Object.keys(other)]);
    return [...keys].every((key) => same(one[key], other[key]));
  }
  return one === other;
}

/** Whether a path is one of those named, or below one. */
export function isBelow(path: string, named: string[]): boolean {
  return named.some((name) => path === name || path.startsWith(`${name}.`));
}

/** Every key of a tree. */
export function keysOf(table: Table): Key[] {
  return [...table.keys, ...table.tables.flatMap(keysOf)];
}
