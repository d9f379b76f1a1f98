import { expect, it } from "vitest";
import { movedSince } from "../src/job/moved-since";
import type { Bench, Job } from "../src/daemon/wire";
import { bench } from "./fixtures";

it("tells an axis that was moved after an alignment from a servo that holds its place", () => {
  const report = { focus_readback_mm: 2.1, e_readback_mm: 1.66 } as NonNullable<Job["report"]>;
  const at = (focus: number | null, e: number | null): Bench => ({
    ...bench,
    axes: bench.axes.map((axis) => ({ ...axis, position_mm: axis.axis === "focus" ? focus : e })),
  });
  expect(movedSince({ report }, at(2.101, 1.659))).toBe(null);
  expect(movedSince({ report }, at(2.2, 1.66))).toBe("moved");
  expect(movedSince({ report }, at(2.1, 1.67))).toBe("moved");
  expect(movedSince({ report }, at(null, 1.66))).toBe("lost");
  expect(movedSince({ report: null }, at(5, 5))).toBe(null);
});
