import type uPlot from "uplot";
import { expect, it } from "vitest";
import { readOff, tickText } from "../src/views/plot";

it("reads off the curves that have names, where they are known", () => {
  const plot = (idx: number | null) =>
    ({
      cursor: { idx },
      data: [
        [1, 2],
        [0.12345678, null],
        [7, 8],
      ],
    }) as unknown as uPlot;
  const names = ["e, mm", "spacing, px", undefined];
  expect(readOff(plot(0), names)).toBe("e, mm 1 · spacing, px 0.123457");
  expect(readOff(plot(1), names)).toBe("e, mm 2");
  expect(readOff(plot(null), names)).toBe("");
});

it("spells ticks without separators, and with a minus that is one", () => {
  expect([30000, -0.1, 0.1 + 0.2, null].map(tickText)).toEqual(["30000", "−0.1", "0.3", ""]);
});
