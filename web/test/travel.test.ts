import { describe, expect, test } from "vitest";
import { nearWall, sideBeyond } from "../src/bench/travel";
import type { Axis } from "../src/daemon/wire";
import { bench } from "./fixtures";

const standing = (position_mm: number | null, homed = true): Axis => ({
  ...(bench.axes.find(({ axis }) => axis === "e") as Axis),
  homed,
  position_mm,
  low_limit_mm: 3.52,
  high_limit_mm: 32,
});

describe("an axis at the ends of where it may go", () => {
  test("stands beyond the wall that came after it, and only goes back from there", () => {
    expect(sideBeyond(standing(2))).toBe("low");
    expect(sideBeyond(standing(33))).toBe("high");
    for (const at of [3.52, 3.5175, 10, 32.005, 32]) expect(sideBeyond(standing(at))).toBeNull();
    expect(sideBeyond(standing(2, false))).toBeNull();
    expect(sideBeyond(standing(null))).toBeNull();
  });

  test("stands at the wall where a held button has ended", () => {
    expect(nearWall(standing(3.52))).toBe(true);
    expect(nearWall(standing(3.55))).toBe(true);
    expect(nearWall(standing(4))).toBe(false);
    expect(nearWall(standing(3.52, false))).toBe(false);
  });
});
