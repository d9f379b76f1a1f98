import { describe, expect, it } from "vitest";
import { another, called, callMe, NAMELESS } from "../src/words/names";
import { strings } from "../src/strings";

describe("how somebody is called", () => {
  it("is by name, and in the reader's words without one", () => {
    expect(called("Ada")).toBe("Ada");
    expect(called(NAMELESS)).toBe(strings.lease.owner);
    expect([called("ada", "first"), another("ada", "first")]).toEqual(["ada", "ada"]);
    expect([called(NAMELESS, "first"), another(NAMELESS, "first")]).toEqual(["A browser", "A browser"]);
  });

  it("turns nothing that stands around a name written from right to left", () => {
    expect(called("שרה 2")).toBe("\u2068שרה 2\u2069");
    expect(called("سارة")).toBe("\u2068سارة\u2069");
  });

  it("is told from this page where another window has the same name", () => {
    callMe("Ada");
    expect(another("Ada")).toBe(strings.lease.elsewhere("Ada"));
    expect(another("Ben")).toBe("Ben");
    callMe(" ");
    expect(another(NAMELESS)).toBe(strings.lease.owner);
  });
});
