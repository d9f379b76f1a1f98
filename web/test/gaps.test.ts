import { expect, it } from "vitest";
import { broken } from "../src/charts/gaps";

it("parts a line where a point is missing, and nowhere else", () => {
  const curve = [1, 2, 3, 4, 5, 6];
  expect(broken([0, 1, 2.2, 3, 4.1, 5], [curve])).toEqual([[0, 1, 2.2, 3, 4.1, 5], curve]);
  const [at, ...curves] = broken([0, 1, 3, 4, 5, 7], [curve, [null, 2, 3, 4, 5, 6]]);
  expect(at).toEqual([0, 1, 2, 3, 4, 5, 6, 7]);
  expect(curves).toEqual([
    [1, 2, null, 3, 4, 5, null, 6],
    [null, 2, null, 3, 4, 5, null, 6],
  ]);
});

it("takes a short pause for none, and nothing for nothing", () => {
  const at = [0, 0.1, 0.2, 2, 2.1];
  const curve = [1, 1, 1, 1, 1];
  expect(broken(at, [curve], 3)[0]).toEqual(at);
  expect(broken(at, [curve], 1)[0]).toEqual([0, 0.1, 0.2, 1.1, 2, 2.1]);
  expect(broken([], [[]])).toEqual([[], []]);
  expect(broken([4], [[1]])).toEqual([[4], [1]]);
});
