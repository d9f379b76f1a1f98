// Which folder of the page builds on which.

import { describe, expect, it } from "vitest";

const sources = import.meta.glob<string>(["../src/**/*.{ts,tsx}", "!../src/gen/**"], {
  query: "?raw",
  import: "default",
  eager: true,
});

/** What each folder takes from others besides types, which bind nothing at run time. What stands beside the folders may take
 *  from any but the views, and the views from any. */
const TAKES: Record<string, string[]> = {
  words: ["strings.ts"],
  browser: [],
  charts: ["words"],
  daemon: ["browser", "gen", "strings.ts", "words"],
  bench: ["browser", "daemon", "strings.ts"],
  design: ["strings.ts", "words"],
  job: ["state.ts", "strings.ts", "words"],
  meter: ["bench", "browser", "state.ts", "strings.ts", "words"],
  picture: ["browser", "daemon", "job", "meter"],
};

const IMPORT =
  /^(?:import|export)\s+([^;]*?)\s*from\s+"(\.[^"?]+)|\bimport\("(\.[^"]+)|\bnew URL\("(\.[^"]+)/gm;

/** The room of a file of the page, or itself where it stands in none; null of any other. */
function roomOf(path: string): string | null {
  const [, room] = /^\/src\/([^/]+)/.exec(path) ?? [];
  return room === undefined ? null : path.includes("/", 5) ? room : `${room.replace(/\.tsx?$/, "")}.ts`;
}

function isOfTypes(names: string): boolean {
  const listed = /^\{([^]*)\}$/
    .exec(names)?.[1]
    ?.split(",")
    .filter((name) => name.trim() !== "");
  return names.startsWith("type ") || (listed?.every((name) => /^\s*type /.test(name)) ?? false);
}

/** What each room takes something from. */
function taken(): Map<string, Set<string>> {
  const rooms = new Map<string, Set<string>>();
  for (const [file, text] of Object.entries(sources)) {
    const at = new URL(file, "file:///test/");
    const room = roomOf(at.pathname) ?? "";
    const takes = rooms.get(room) ?? new Set();
    for (const [, names, ...paths] of text.matchAll(IMPORT)) {
      const from = roomOf(new URL(paths.find(Boolean) ?? "", at).pathname);
      if (from !== null && from !== room && !isOfTypes(names ?? "")) takes.add(from);
    }
    rooms.set(room, takes);
  }
  return rooms;
}

describe("the page's files", () => {
  it("are no longer than a reader keeps in the head", () => {
    const long = Object.entries(sources).filter(([, text]) => text.split("\n").length > 450);
    expect(long.map(([file]) => file)).toEqual([]);
  });
});

describe("the page's folders", () => {
  const rooms = taken();
  it.each(Object.keys(TAKES))("%s takes what it takes", (room) => {
    expect([...(rooms.get(room) ?? [])].sort()).toEqual(TAKES[room]);
  });

  it("are those, beside the words, the views and what all of them share", () => {
    const others = [...rooms.keys()].filter((room) => !(room in TAKES) && !room.endsWith(".ts"));
    expect(others.sort()).toEqual(["strings", "views"]);
    expect([...rooms.keys()].filter((room) => rooms.get(room)?.has("views"))).toEqual(["main.ts"]);
  });
});
