import { describe, expect, it } from "vitest";
import { allOf, moved, SHORTEST_S, stretchOf, zoomed } from "../src/charts/stretch";
import { SPAN_S } from "../src/charts/trail";
import { timeOfDay } from "../src/views/live/time-axis";

describe("the stretch of time that charts show", () => {
  const all = allOf(0, 1000);
  it("is the last two minutes, or all there is, which is two minutes at least", () => {
    expect(all).toEqual({ from: 0, to: 1000 });
    expect(stretchOf("recent", all)).toEqual({ from: 1000 - SPAN_S, to: 1000 });
    expect(stretchOf("whole", all)).toEqual(all);
    expect(allOf(null, 1000)).toEqual({ from: 1000 - SPAN_S, to: 1000 });
    expect(allOf(995, 1000).from).toBe(1000 - SPAN_S);
  });

  it("is zoomed about a time that stays where it is, within what there is", () => {
    const near = zoomed({ from: 200, to: 400 }, 0.5, 250, all);
    expect(near).toEqual({ from: 225, to: 325 });
    expect(zoomed({ from: 900, to: 1000 }, 2, 1000, all)).toEqual({ from: 800, to: 1000 });
    expect(zoomed({ from: 900, to: 1000 }, 2, 900, all)).toEqual({ from: 800, to: 1000 });
    expect(zoomed({ from: 0, to: 900 }, 1.5, 450, all)).toBe("whole");
    const short = zoomed({ from: 10, to: 13 }, 1e-6, 11, all);
    expect(typeof short === "object" && short.to - short.from).toBeCloseTo(SHORTEST_S);
  });

  it("is moved no further than what there is", () => {
    expect(moved({ from: 200, to: 400 }, 50, all)).toEqual({ from: 250, to: 450 });
    expect(moved({ from: 200, to: 400 }, -500, all)).toEqual({ from: 0, to: 200 });
    expect(moved({ from: 200, to: 400 }, 900, all)).toEqual({ from: 800, to: 1000 });
  });

  it("goes on with time where it is moved to the newest end, or by nothing", () => {
    const recent = stretchOf("recent", all);
    expect(moved(recent, 0, all)).toBe("recent");
    expect(moved({ from: 200, to: 200 + SPAN_S }, 5000, all)).toBe("recent");
    expect(moved(recent, -1, all)).toEqual({ from: 999 - SPAN_S, to: 999 });
    expect(moved(all, 10, all)).toBe("whole");
  });

  it("is told by the clock, the day before and after, too", () => {
    const noon = 12 * 3600;
    expect(timeOfDay(noon + 61, 60)).toBe("12:01");
    expect(timeOfDay(noon + 61, 5)).toBe("12:01:01");
    expect(timeOfDay(noon + 61.24, 0.5)).toBe("12:01:01.2");
    expect([timeOfDay(-1, 1), timeOfDay(24 * 3600 + 5, 1)]).toEqual(["23:59:59", "00:00:05"]);
  });
});
