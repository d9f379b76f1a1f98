import { expect, it } from "vitest";
import { boardsAt, LENS_X, opening, ringAbout, SIZE } from "../src/job/set-up-drawing";

it("boards stand to scale along the axis, the nearest level lowest, and a flat one is one", () => {
  const [near, middle, far] = boardsAt([175.2, 159.2, 167.2]);
  expect([near, middle, far].map((board) => board?.distanceMm)).toEqual([159.2, 167.2, 175.2]);
  const away = [near, middle, far].map((board) => LENS_X - (board?.x ?? NaN));
  expect((away[0] ?? 0) / (away[2] ?? 1)).toBeCloseTo(159.2 / 175.2, 6);
  expect(near?.bottom).toBeGreaterThan(middle?.bottom ?? Infinity);
  expect(middle?.bottom).toBe(near?.top);
  expect(boardsAt([300, 300, 300])).toHaveLength(1);
});

it("the ring's marks lie about the number to be set, a stop apart, within the drawing", () => {
  for (const number of [1.2, 3.14, 5.6, 16]) {
    const marks = ringAbout(number);
    expect(marks.length).toBeGreaterThan(1);
    for (const { x } of marks) (expect(x).toBeGreaterThan(20), expect(x).toBeLessThan(SIZE.width - 20));
    for (const { x, stop } of marks) expect(x < SIZE.width / 2).toBe(stop < number);
  }
  expect(opening(1)).toBeLessThan(1);
  expect(opening(2)).toBeGreaterThan(opening(4));
});
