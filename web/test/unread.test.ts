import { describe, expect, it } from "vitest";
import { initial, type State } from "../src/state";
import { strings } from "../src/strings";
import { nothingRead, whyMissing } from "../src/meter/unread";
import type { Bench } from "../src/daemon/wire";
import { bench as snapshotBench, job } from "./fixtures";

describe("what is said where nothing is read", () => {
  const missing = {
    is: "lost" as const,
    why: "the board went",
    targetPx: 20,
    tolerancePx: 0,
    capturedAt: 0,
    monotonicMs: 0,
  };
  const over = (in_view: NonNullable<Bench["in_view"]>): State => ({
    ...initial,
    bench: { ...snapshotBench, in_view },
  });

  it("is why: of a board of several levels and of none before the lens, that", () => {
    const sought = {
      what: strings.meter.missing.lost,
      text: "the board went",
      daemons: true,
      sought: true,
      besides: null,
    };
    expect(whyMissing(missing, over("flat_board"))).toEqual(sought);
    const steps = whyMissing(missing, over("stepped_board"));
    expect([steps.text, steps.besides]).toEqual([strings.meter.overSteps, "the board went"]);
    expect(whyMissing(missing, over("other"))).toEqual({
      what: strings.meter.missing.refused,
      text: strings.meter.overNone,
      daemons: false,
      sought: false,
      besides: null,
    });
    for (const view of ["other", "stepped_board"] as const) {
      const refused = whyMissing({ ...missing, is: "refused", why: "dark" }, over(view));
      expect(refused).toMatchObject({ text: "dark", daemons: true, sought: false });
    }
    expect(whyMissing(missing, initial)).toEqual(sought);
  });

  it("is that a job has not come to it yet, and not how to begin one", () => {
    expect(nothingRead(initial).what).toBe(strings.meter.unheard);
    expect(nothingRead(over("unknown")).what).toBe(strings.meter.none);
    const at = { ...over("unknown"), jobs: [job("a", 1)] };
    expect(nothingRead(at).what).toBe(strings.meter.noneOfThis);
    // One that has ended comes to nothing more.
    expect(nothingRead({ ...at, jobs: [job("a", 2, "failed")] }).what).toBe(strings.meter.none);
  });
});
