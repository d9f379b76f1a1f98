import { describe, expect, it } from "vitest";
import { check, draftOf, FIELDS, implied, KINDS, unless } from "../src/job/kinds";
import { numberOf } from "../src/words/number";
import { comparison } from "../src/charts/comparison";
import { everything, queryOf } from "../src/job/query";
import { bench, design, job } from "./fixtures";

const faults = (draft: ReturnType<typeof draftOf>) => {
  const checked = check(draft, FIELDS[draft.kind], bench.axes, "mm");
  return checked.ok ? [] : Object.keys(checked.faults);
};

describe("the form of a job", () => {
  it("has all nine kinds, and asks for nothing that a kind does not take", () => {
    expect(KINDS).toHaveLength(9);
    for (const kind of ["joint_alignment", "air_only", "shell_only", "l_bound_measurement"] as const) {
      expect(FIELDS[kind]).toEqual([]);
      expect(check(draftOf(kind), FIELDS[kind], bench.axes, "mm")).toEqual({ ok: true, request: { kind } });
    }
  });

  it("asks to be recorded only where that is wanted", () => {
    for (const kind of KINDS.filter((kind) => FIELDS[kind].length === 0)) {
      expect(check(draftOf(kind, "", true), FIELDS[kind], bench.axes, "mm")).toEqual({
        ok: true,
        request: { kind, record: true },
      });
    }
  });

  it("wants what is needed, within what is allowed", () => {
    // e is held within the e axis's travel.
    const held = (e_mm: string) => faults({ ...draftOf("clarity_only"), numbers: { e_mm } });
    expect([held("10"), held("40"), held("-3")]).toEqual([[], ["e_mm"], ["e_mm"]]);
    const sweep = draftOf("focus_sweep");
    expect(faults(sweep)).toEqual(["from_mm", "to_mm"]);
    expect(faults({ ...sweep, numbers: { from_mm: "-3", to_mm: "1" } })).toEqual(["from_mm"]);
    expect(faults({ ...sweep, numbers: { from_mm: "0", to_mm: "1", steps: "2.5" } })).toEqual(["steps"]);
    expect(faults({ ...sweep, numbers: { from_mm: "1", to_mm: "1,0" } })).toEqual(["to_mm"]);
    expect(faults({ ...sweep, axis: "e", numbers: { from_mm: "20", to_mm: "x" } })).toEqual(["to_mm"]);
    expect(
      check(
        { ...sweep, note: " drift ", numbers: { from_mm: "0,5", to_mm: "1", steps: "5" } },
        FIELDS.focus_sweep,
        bench.axes,
        "mm",
      ),
    ).toEqual({
      ok: true,
      request: { kind: "focus_sweep", note: "drift", axis: "focus", from_mm: 0.5, to_mm: 1, steps: 5 },
    });
  });

  it("takes lengths in the unit chosen, and says its bounds in it", () => {
    const sweep = {
      ...draftOf("focus_sweep"),
      numbers: { from_mm: "500", to_mm: "1234,5", duration_s: "9" },
    };
    expect(check(sweep, FIELDS[sweep.kind], bench.axes, "µm")).toEqual({
      ok: true,
      request: { kind: "focus_sweep", axis: "focus", from_mm: 0.5, to_mm: 1.2345 },
    });
    const far = check(
      { ...sweep, numbers: { from_mm: "-2001", to_mm: "0" } },
      FIELDS.focus_sweep,
      bench.axes,
      "µm",
    );
    expect(far).toEqual({ ok: false, faults: { from_mm: "It has to be within −2000 µm to 5000 µm." } });
    const watch = { ...draftOf("spacing_watch"), numbers: { duration_s: "0.5" } };
    expect(check(watch, FIELDS[watch.kind], bench.axes, "µm")).toEqual({
      ok: false,
      faults: { duration_s: "It has to be within 1 s to 86400 s." },
    });
  });

  it("says what its numbers come to together", () => {
    const sweep = { ...draftOf("focus_sweep"), numbers: { from_mm: "0", to_mm: "1" } };
    expect(implied(sweep, bench.axes, "mm")).toBe("11 positions, 0.1000 mm apart");
    expect(
      implied({ ...sweep, numbers: { from_mm: "1000", to_mm: "0", steps: "5" } }, bench.axes, "µm"),
    ).toBe("5 positions, 250.0 µm apart");
    expect(implied({ ...sweep, numbers: { from_mm: "0" } }, bench.axes, "mm")).toBeNull();
    const watch = { ...draftOf("spacing_watch"), numbers: { duration_s: "60", interval_s: "5" } };
    expect(implied(watch, bench.axes, "mm")).toBe("About 13 measurements");
    expect(implied(draftOf("joint_alignment"), bench.axes, "mm")).toBeNull();
  });

  it("measures no more than five hundred times", () => {
    const watch = { ...draftOf("spacing_watch"), numbers: { duration_s: "3600" } };
    expect(faults(watch)).toEqual(["interval_s"]);
    expect(faults({ ...watch, numbers: { duration_s: "3600", interval_s: "10" } })).toEqual([]);
  });

  it("homes at least one axis", () => {
    const homing = draftOf("homing");
    expect(check(homing, FIELDS[homing.kind], bench.axes, "mm")).toEqual({
      ok: true,
      request: { kind: "homing", axes: ["focus", "e"] },
    });
    expect(faults({ ...homing, axes: [] })).toEqual(["axes"]);
  });

  it("reads numbers as people type them and says what stands where none is typed", () => {
    expect([numberOf("1,5"), numberOf(" −2 "), numberOf("")]).toEqual([1.5, -2, NaN]);
    expect([numberOf("0x10"), numberOf("Infinity"), numberOf("1e-3"), numberOf("-.5")]).toEqual([
      NaN,
      NaN,
      1e-3,
      -0.5,
    ]);
    expect([numberOf("0,125"), numberOf("12,3456"), numberOf("1.234")]).toEqual([0.125, 12.3456, 1.234]);
    expect(unless("e_mm", design, "mm")).toBe("30");
    expect(unless("e_mm", design, "µm")).toBe("30000");
    expect(unless("distance_mm", null, "mm")).toBe("");
  });
});

describe("the history", () => {
  it("asks for what the filter says, days with all their hours", () => {
    expect(queryOf(everything, null).toString()).toBe("limit=20");
    const query = queryOf(
      { text: " drift ", kind: "homing", state: "failed", since: "2026-03-01", until: "2026-03-01" },
      "c",
    );
    expect([query.get("q"), query.get("kind"), query.get("state"), query.get("cursor")]).toEqual([
      "drift",
      "homing",
      "failed",
      "c",
    ]);
    const [since, until] = [query.get("since"), query.get("until")].map((text) => Date.parse(text ?? ""));
    expect((until ?? 0) - (since ?? 0)).toBe(24 * 3600 * 1000);
    expect(queryOf({ ...everything, since: "soon" }, null).has("since")).toBe(false);
    // A year with a digit too many is later than every run, and none that the API does not know.
    expect(queryOf({ ...everything, since: "12026-01-01" }, null).get("since")).toBe("9998-12-31T00:00:00Z");
    expect(queryOf({ ...everything, until: "9999-12-31" }, null).get("until")).toBe("9998-12-31T00:00:00Z");
    expect(queryOf({ ...everything, since: "0026-01-02" }, null).get("since")).toMatch(/^0026-01-0/);
  });

  it("lays two runs of unlike length over one another", () => {
    const iteration = (number: number, spacing_px: number) => ({
      number,
      at: "2026-01-01T00:00:00Z",
      stage: "air" as const,
      kind: "move" as const,
      decision: "",
      spacing: {
        spacing_px,
        spacing_sigma_px: 0.01,
        tilt_x_px: 0,
        tilt_y_px: 0,
        curvature_px: 0,
        pairs: 9,
        frames: 1,
      },
      spacing_target_px: 20,
    });
    const one = { ...job("a", 1), iterations: [iteration(1, 25), iteration(2, 21), iteration(3, 20)] };
    const other = { ...job("b", 1), iterations: [iteration(1, 18)] };
    expect(comparison([one, other])).toEqual([
      [1, 2, 3],
      [5, 1, 0],
      [-2, null, null],
    ]);
    const repeated = [{ ...iteration(1, 25), discarded: true }, iteration(2, 21)];
    expect(comparison([{ iterations: repeated }, other])).toEqual([
      [1, 2],
      [null, 1],
      [-2, null],
    ]);
    expect(comparison([])).toEqual([[]]);
  });
});
