import { describe, expect, it } from "vitest";
import { isBelow, keysOf, same, tableOf, valueAt, withValue } from "../src/design/config-schema";
import { isLarge } from "../src/bench/pace";
import { keep, named, recall, standard } from "../src/preferences";
import { addressOf, routeOf } from "../src/browser/route";
import { extent, overlaysOn } from "../src/picture/show";
import { initial, may } from "../src/state";
import { SPACE } from "../src/bench/stop-key";
import { follow, noTrail, SPAN_S, type Trail } from "../src/charts/trail";
import { lookedAt, wishOf } from "../src/daemon/wish";
import { length, signedLength } from "../src/words/units";

const id = "0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11";

describe("the address", () => {
  it("names a page and its jobs, and the live page where it names none", () => {
    expect(routeOf("#/history/" + id)).toEqual({ page: "history", jobs: [id] });
    expect(routeOf(addressOf("meter"))).toEqual({ page: "meter", jobs: [] });
    expect(routeOf(addressOf("alignment", id))).toEqual({ page: "alignment", jobs: [id] });
    for (const hash of ["", "#", "#/", "#/nowhere"])
      expect(routeOf(hash)).toEqual({ page: "live", jobs: [] });
    expect(routeOf("#/alignment/<script>").jobs).toEqual([]);
  });
});

describe("preferences", () => {
  const kept = (text: string | null) => ({ getItem: () => text });
  it("are as they were kept", () => {
    let text = "";
    const mine = {
      ...standard,
      name: "Ana",
      language: "de" as const,
      unit: "µm" as const,
      overlays: ["grid" as const],
      show: "depth" as const,
      stepMm: 1,
    };
    const storage = { getItem: () => text, setItem: (_name: string, value: string) => void (text = value) };
    keep(storage, mine, standard);
    expect(recall(storage)).toEqual(mine);
    // Another tab of the browser, which was opened before, changes something else.
    keep(storage, { ...standard, stepMm: 0.01 }, standard);
    expect(recall(storage)).toEqual({ ...mine, stepMm: 0.01 });
  });

  it("have the name that was given in another tab, and one's own where there is one", () => {
    const ana = { ...standard, name: "Ana", language: "de" as const };
    expect(named(standard, ana)).toEqual({ ...standard, name: "Ana" });
    const ben = { ...standard, name: "" };
    expect(named(ben, ana)).toBe(ben);
    expect(named(standard, standard)).toBe(standard);
  });

  it("are standard where what was kept is none", () => {
    for (const text of [
      null,
      "",
      "{",
      "null",
      "7",
      '{"stepMm":99,"unit":"inch","language":"tlh","stopKey":{"code":""},"overlays":"x","show":"upside_down"}',
    ]) {
      expect(recall(kept(text))).toEqual(standard);
    }
    expect(recall(kept('{"overlays":["error","nothing"]}'))).toMatchObject({
      overlays: ["error"],
      stopKey: SPACE,
    });
  });
});

describe("the picture shown", () => {
  it("is measured in raw pixels where it is the raw frame, however coarse, and else in its own", () => {
    const coarse = { width: 580, height: 400 };
    const sizes = { widthPx: 1160, heightPx: 800 };
    expect(extent({ ...sizes, show: "raw" }, coarse)).toEqual({ width: 1160, height: 800 });
    expect(extent({ ...sizes, show: "central" }, coarse)).toEqual(coarse);
  });

  it("has nothing over it but on the raw frame, and that the same each time", () => {
    expect(overlaysOn("raw", ["grid"])).toEqual(["grid"]);
    expect(overlaysOn("depth", ["grid"])).toEqual([]);
    expect(overlaysOn("depth", ["grid"])).toBe(overlaysOn("central", ["error"]));
  });
});

describe("what the page wishes for", () => {
  const picture = { overlay: true, show: "depth" } as const;
  const wish = (hash: string, visible = true) => wishOf(lookedAt(routeOf(hash), visible), picture);
  it("is every picture on the live page, and nothing where nobody looks", () => {
    expect(wish("#/live")).toEqual({ ...picture, readings: true, pictures: true });
    for (const wished of [wish("#/live", false), wish("#/design"), wish("#/alignment/" + id)])
      expect([wished.pictures, wished.readings]).toEqual([false, false]);
  });

  it("is no picture where the meter stands alone", () => {
    for (const page of ["#/alignment", "#/meter"])
      expect(wish(page)).toEqual({ readings: true, pictures: false, overlay: false, show: "raw" });
  });
});

describe("a trail", () => {
  it("goes back as far however many points come, and leaves out those that no chart shows apart", () => {
    let trail: Trail<number> = noTrail;
    for (let i = 0; i < 60 * 300; i += 1) trail = follow(trail, i / 60, i, (point) => point);
    expect(trail.at.length).toBeLessThanOrEqual(1500);
    expect((trail.at.at(-1) ?? 0) - (trail.at[0] ?? 0)).toBeGreaterThan(SPAN_S - 1);
    expect(follow(trail, 300.001, 7, (point) => point).at.at(-1)).toBeGreaterThan(299.9);
  });

  it("forgets what is too old, and is bounded", () => {
    let trail: Trail<number> = noTrail;
    for (let second = 0; second < 300; second += 1) trail = follow(trail, second, second, (point) => point);
    expect(trail.points[0]).toBe(299 - SPAN_S);
    expect(trail.points.at(-1)).toBe(299);
    for (let i = 0; i < 5000; i += 1) trail = follow(trail, 300 + i / 1000, i, (point) => point);
    expect(trail.at.length).toBeLessThanOrEqual(1500);
    expect(trail.at).toHaveLength(trail.points.length);
  });
});

describe("what one may do", () => {
  it("goes by the scope, and a stranger may nothing", () => {
    const session = { demanded: true, name: "Vera", scope: "control" as const, signed_in: true };
    expect(may({ ...initial, session }, "view")).toBe(true);
    expect(may({ ...initial, session }, "control")).toBe(true);
    expect(may({ ...initial, session }, "admin")).toBe(false);
    expect(may({ ...initial, session: "stranger" }, "view")).toBe(false);
    expect(may(initial, "view")).toBe(false);
  });
});

describe("moves by hand", () => {
  it("ask before more than a millimetre, not before a millimetre", () => {
    expect([isLarge(0, 1), isLarge(0.1, 1.1), isLarge(0, -1.001), isLarge(5, 5)]).toEqual([
      false,
      false,
      true,
      false,
    ]);
  });

  it("show lengths in the unit chosen", () => {
    expect([length(1.2345, "mm"), length(1.2345, "µm"), signedLength(0.0012, "mm", 4)]).toEqual([
      "1.234 mm",
      "1234 µm",
      "+0.0012 mm",
    ]);
    expect(signedLength(0.0012, "µm", 4)).toBe("+1.2 µm");
  });
});

describe("the configuration's schema", () => {
  const schema = {
    $defs: {
      Side: { oneOf: [{ const: "low", description: "Small." }, { const: "high" }] },
      Axis: {
        type: "object",
        description: "One axis.",
        properties: { approach: { $ref: "#/$defs/Side", default: "low" }, on: { type: "boolean" } },
      },
    },
    properties: {
      axis: { $ref: "#/$defs/Axis", description: "The e axis." },
      steps: { type: "integer", default: 3, description: "How many." },
      list: { type: "array" },
      name: { type: ["string", "null"] },
    },
  };
  const table = tableOf(schema);

  it("becomes a tree of keys, each with what it is edited with", () => {
    expect(table?.tables.map((inner) => [inner.path, inner.meaning])).toEqual([["axis", "The e axis."]]);
    const editors = Object.fromEntries(table ? keysOf(table).map((key) => [key.path, key.editor]) : []);
    expect(editors).toEqual({
      steps: { by: "number", whole: true },
      list: { by: "json" },
      name: { by: "text" },
      "axis.approach": {
        by: "choice",
        choices: [
          { value: "low", meaning: "Small." },
          { value: "high", meaning: "" },
        ],
      },
      "axis.on": { by: "switch" },
    });
    expect(tableOf(null)).toBeNull();
  });

  it("does not go round in circles", () => {
    const circle = {
      $defs: { A: { properties: { a: { $ref: "#/$defs/A" } } } },
      properties: { a: { $ref: "#/$defs/A" } },
    };
    expect(tableOf(circle)?.tables).toHaveLength(1);
  });

  it("finds and changes values without touching the original", () => {
    const config = { axis: { approach: "low", limits: [1, 2] }, steps: 3 };
    expect(valueAt(config, "axis.approach")).toBe("low");
    expect(valueAt(config, "axis.nothing.there")).toBeUndefined();
    const other = withValue(config, "axis.approach", "high");
    expect(other).toEqual({ axis: { approach: "high", limits: [1, 2] }, steps: 3 });
    expect(config.axis.approach).toBe("low");
    expect(same(config, { steps: 3, axis: { limits: [1, 2], approach: "low" } })).toBe(true);
    expect(same(config, other)).toBe(false);
    expect([isBelow("server.auth", ["server"]), isBelow("serverless", ["server"])]).toEqual([true, false]);
  });
});
