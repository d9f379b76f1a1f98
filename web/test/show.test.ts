import { describe, expect, it } from "vitest";
import { drawable } from "../src/picture/show";

describe("what is laid over the picture", () => {
  it("has no error of a spacing that is no one board's", () => {
    expect(drawable(["error", "saturation"], { direction: "two_boards" })).toEqual(["saturation"]);
    expect(drawable(["error"], { direction: "levels" })).toEqual([]);
    expect(drawable(["error"], { direction: "larger" })).toEqual(["error"]);
    expect(drawable(["error"], null)).toEqual(["error"]);
  });
});
