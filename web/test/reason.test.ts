import { expect, test } from "vitest";
import { reasonOf } from "../src/job/reason";

test("a reason is told where it says more than the state", () => {
  expect(["done", "cancelled", "", null].map((reason) => reasonOf({ reason }))).toEqual([
    null,
    null,
    null,
    null,
  ]);
  expect(["cancelled by Ben", "stopped by Ben"].map((reason) => reasonOf({ reason }))).toEqual([
    "by Ben",
    "stopped by Ben",
  ]);
});
