import { describe, expect, it } from "vitest";
import { barred, switched, unhomed } from "../src/job/barred";
import { strings } from "../src/strings";
import { wayOn } from "../src/job/way-on";
import { bench, job } from "./fixtures";

describe("the way on from a job that ended early", () => {
  const kinds = (...of: Parameters<typeof wayOn>) => wayOn(...of)?.ways.map(({ request }) => request.kind);
  const holds = { ...bench, air_step_holds: true };

  it("is the shell step where the air step holds, and else the whole from its beginning", () => {
    const stopped = { ...job("a", 3, "cancelled"), request: { kind: "joint_alignment" as const, note: "n" } };
    expect(wayOn(stopped, holds)).toEqual({
      airStep: "holds",
      ways: [
        { is: "goOn", request: { kind: "shell_only", note: "n" } },
        { is: "again", request: { kind: "joint_alignment", note: "n" } },
      ],
    });
    expect(kinds(stopped, bench)).toEqual(["joint_alignment"]);
    // What the picture contradicts may be the air step.
    const doubted = { ...holds, contradicted: "it fits boards that stood elsewhere" };
    expect(wayOn(stopped, doubted)?.airStep).toBe("doubtful");
    expect(kinds(stopped, doubted)).toEqual(["joint_alignment", "shell_only"]);
    // A shell step that has lost its air step would only fail again.
    const shell = {
      ...job("a", 3, "failed"),
      kind: "shell_only" as const,
      request: { kind: "shell_only" as const },
    };
    expect(kinds(shell, holds)).toEqual(["shell_only", "joint_alignment"]);
    expect(kinds(shell, bench)).toEqual(["joint_alignment"]);
  });

  it("is the same again for every other kind", () => {
    const request = { kind: "spacing_watch" as const, duration_s: 60 };
    const watch = { ...job("a", 3, "interrupted"), kind: "spacing_watch" as const, request };
    expect(wayOn(watch, holds)).toEqual({ airStep: null, ways: [{ is: "again", request }] });
  });

  it("is homing first for a sweep of an axis that has no place", () => {
    const request = { kind: "focus_sweep" as const, axis: "e" as const, from_mm: 20, to_mm: 10 };
    const swept = { ...job("a", 3, "failed"), kind: "focus_sweep" as const, request };
    const lost = { ...bench, axes: bench.axes.map((one) => ({ ...one, homed: one.axis !== "e" })) };
    expect(wayOn(swept, lost)?.ways).toEqual([
      { is: "goOn", request: { kind: "homing", axes: ["e"] } },
      { is: "again", request },
    ]);
    expect(unhomed(lost, { kind: "focus_sweep", axis: "focus" })).toBeNull();
    expect(unhomed(lost, { kind: "joint_alignment" })).toBeNull();
    const homed = { ...bench, axes: bench.axes.map((one) => ({ ...one, homed: true })) };
    expect(kinds(swept, homed)).toEqual(["focus_sweep"]);
  });

  it("is none while it runs, and after it has come to its end", () => {
    for (const state of ["running", "converged", "succeeded"] as const) {
      expect(wayOn(job("a", 1, state), holds)).toBeNull();
    }
  });
});

describe("the shell step", () => {
  it("begins where an air step holds that it can go on from", () => {
    const why = (air_step_holds: boolean, kind: "shell_only" | "air_only" = "shell_only") =>
      barred({ ...bench, air_step_holds }, { kind });
    expect(why(true)).toEqual([]);
    expect(why(false)).toEqual([strings.byHand.airFirst]);
    expect(why(false, "air_only")).toEqual([]);
  });
});

describe("what is not there", () => {
  it("keeps the jobs from beginning that need it", () => {
    const [focus, e] = bench.axes;
    const lost = { ...bench, axes: [focus!, { ...e!, connected: false }] };
    const why = (kind: "air_only" | "spacing_watch" | "homing", of = lost) => barred(of, { kind });
    expect(why("air_only")).toEqual([strings.byHand.plugFirst("e")]);
    expect(barred(lost, { kind: "homing", axes: ["focus"] })).toEqual([]);
    expect(why("spacing_watch")).toEqual([]);
    const blind = { ...bench, camera: { ...bench.camera, online: false } };
    expect(why("spacing_watch", blind)).toEqual([strings.byHand.cameraFirst]);
    expect(why("homing", blind)).toEqual([]);
  });
});

describe("an axis on its limit switch", () => {
  const at = (...pressed: ("focus" | "e")[]) => ({
    ...bench,
    axes: bench.axes.map((axis) => ({ ...axis, limit_switch: pressed.includes(axis.axis) })),
  });

  it("keeps every job that would move it from beginning, and no other", () => {
    expect(switched(at("focus"), { kind: "joint_alignment" })).toEqual(["focus"]);
    expect(switched(at("focus", "e"), { kind: "shell_only" })).toEqual(["focus", "e"]);
    expect(switched(at(), { kind: "joint_alignment" })).toEqual([]);
    expect(switched(at("e"), { kind: "focus_sweep", axis: "focus" })).toEqual([]);
    expect(switched(at("e"), { kind: "focus_sweep", axis: "e" })).toEqual(["e"]);
    expect(switched(at("e"), { kind: "homing", axes: ["focus"] })).toEqual([]);
    expect(switched(at("e"), { kind: "homing" })).toEqual(["e"]);
    expect(switched(at("focus", "e"), { kind: "spacing_watch" })).toEqual([]);
  });
});
