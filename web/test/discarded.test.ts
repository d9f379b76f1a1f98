import { expect, it } from "vitest";
import { isDiscarded } from "../src/discarded";
import type { JobStep } from "../src/wire";

it("counts no more what was measured between a step and its being done again", () => {
  const at = (minute: number) => `2026-01-01T00:0${minute}:00Z`;
  const step = (number: number | null, minute: number | null, repeats: number | null = null): JobStep => ({
    name: "triple_board_in_air",
    state: minute === null ? "next" : "done",
    number,
    repeats,
    began_at: minute === null ? null : at(minute),
  });
  const steps = [step(1, 0), step(2, 2), step(3, 4), step(4, 6, 2), step(null, null)];
  const told = [1, 2, 3, 5, 6, 7].map((minute) => isDiscarded({ steps }, { at: at(minute) }));
  expect(told).toEqual([false, true, true, true, false, false]);
  expect(isDiscarded({}, { at: at(1) })).toBe(false);
});
