import { describe, expect, it } from "vitest";
import { Sameness } from "../src/sameness";

describe("pictures that come again", () => {
  const of = (...bytes: number[]) => new Uint8Array(bytes);
  it("are counted while frame after frame is the same to the last byte", () => {
    const sameness = new Sameness();
    const note = (seq: number, bytes: Uint8Array, replayed = false) =>
      sameness.note(bytes, { seq, replayed });
    expect([note(1, of(1, 2, 3)), note(2, of(1, 2, 4)), note(3, of(1, 2, 4)), note(4, of(1, 2, 4))]).toEqual([
      1, 1, 2, 3,
    ]);
    // A frame that is sent again is no other.
    expect(note(4, of(1, 2, 4))).toBe(3);
    expect(note(5, of(1, 2))).toBe(1);
    expect(note(6, of(1, 2), true)).toBe(1);
  });
});
