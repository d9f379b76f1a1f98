import { describe, expect, it } from "vitest";
import { nameOf } from "../src/picture/kept-picture";
import { Marking, type Seen } from "../src/picture/marking";
import { lengthOf, noMarks, type Marks } from "../src/picture/marks";

const frame = { width: 400, height: 300 };
/** The frame at twice its size. */
const seen: Seen = { viewport: { scale: 2, left: 0, top: 0 }, view: { width: 800, height: 600 }, frame };

function marking(of: Seen | null = seen) {
  let marks: Marks = noMarks;
  return {
    marking: new Marking(
      () => of,
      (next) => (marks = next),
    ),
    marks: () => marks,
  };
}

describe("measuring in the picture", () => {
  it("begins in the middle of what is seen, and is drawn from pixel to pixel whichever way", () => {
    const { marking: one, marks } = marking();
    one.use("region");
    expect(marks().region).toEqual({ x: 150, y: 112, width: 101, height: 76 });
    one.draw({ x: 20, y: 30 }, { x: 10, y: 5 });
    expect(marks().region).toEqual({ x: 10, y: 5, width: 11, height: 26 });
    expect(one.pixel({ x: 21, y: 7 })).toEqual({ x: 10, y: 3 });
    expect(one.pixel({ x: -50, y: 5000 })).toEqual({ x: 0, y: 299 });
    one.use("ruler");
    one.draw({ x: 10, y: 10 }, { x: 40, y: 50 });
    expect(marks()).toMatchObject({ region: null, ruler: { from: { x: 10, y: 10 }, to: { x: 40, y: 50 } } });
    expect(marks().ruler && lengthOf(marks().ruler as never)).toBe(50);
    one.use(null);
    expect(marks()).toEqual(noMarks);
  });

  it("goes by keys, by one pixel at least, and not out of the frame", () => {
    const { marking: one, marks } = marking();
    one.use("region");
    one.draw({ x: 0, y: 0 }, { x: 9, y: 9 });
    one.shift(6, 0, false);
    one.shift(0, 1, false);
    expect(marks().region).toEqual({ x: 3, y: 1, width: 10, height: 10 });
    one.shift(0, -5000, false);
    one.shift(5000, -5000, true);
    expect(marks().region).toEqual({ x: 3, y: 0, width: 397, height: 1 });
  });

  it("is of the raw frame that is shown, keeps the crosshair, and ends with a smaller frame", () => {
    const { marking: one, marks } = marking();
    one.showCrosshair(true);
    one.use("region");
    const held = marks();
    one.keepWithin(frame);
    expect(marks()).toBe(held);
    one.keepWithin({ width: 200, height: 150 });
    expect(marks()).toEqual({ ...noMarks, crosshair: true });
    const none = marking(null);
    none.marking.use("region");
    expect([none.marking.tool, none.marks().region]).toEqual([null, null]);
  });
});

it("what is kept has its time, its frame and what it is in its name", () => {
  const about = {
    seq: 812,
    simulated: false,
    replayed: false,
    preview: false,
    capturedAt: new Date(Date.UTC(2026, 2, 4, 5, 6, 7, 89)),
  };
  expect(nameOf({ ...about, kind: "raw" })).toBe("plenalign-20260304T050607.089Z-frame-812-raw.png");
  expect(nameOf({ ...about, kind: "view", simulated: true, preview: true })).toBe(
    "plenalign-20260304T050607.089Z-frame-812-simulated-preview-view.png",
  );
  expect(nameOf({ ...about, kind: "raw", capturedAt: new Date(NaN) })).toContain("-undated-");
});
