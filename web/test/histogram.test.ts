import { expect, test } from "vitest";
import { drawn } from "../src/picture/histogram";

test("what is clipped at either end is told from what lies between", () => {
  const counts = new Array<number>(256).fill(0);
  counts[0] = 100;
  counts[128] = 10;
  // From 250 of 255 on.
  counts[252] = 30;
  counts[255] = 70;
  const { black, between, white } = drawn({ counts, bits: 8, levels_per_range: 1, clipped_from: 250 });
  expect(black).toBe("M0 1V0H0.0039V1Z");
  // As high as the logarithm of its pixels.
  const top = (1 - Math.log(11) / Math.log(101)).toFixed(4);
  expect(between).toBe(`M0.5 1V${top}H0.5039V1Z`);
  expect(white).toBe("M0.9766 1V0H1V1Z");
  // Video levels are clipped from 231 on.
  expect(drawn({ counts, bits: 8, levels_per_range: 1, clipped_from: 231 }).white).toBe("M0.9023 1V0H1V1Z");
});

test("nothing is drawn where there is nothing, and the last range ends with the levels", () => {
  const counts = new Array<number>(7).fill(0);
  const coarse = { counts, bits: 12, levels_per_range: 600, clipped_from: 4014 };
  expect(drawn(coarse)).toEqual({ black: "", between: "", white: "" });
  counts[3] = 5;
  expect(drawn(coarse).between).toMatch(/^M0.4395 1V0H0.5859V1Z$/);
});
