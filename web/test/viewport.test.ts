import { describe, expect, it } from "vitest";
import { fit, isWhole, pan, pixelAt, zoom } from "../src/picture/viewport";

const view = { width: 500, height: 400 };
const frame = { width: 1160, height: 1160 };

describe("the viewport", () => {
  it("shows the whole frame in the middle", () => {
    const whole = fit(view, frame);
    expect(whole.scale).toBeCloseTo(400 / 1160, 12);
    expect(whole.left).toBeCloseTo(50, 9);
    expect(whole.top).toBeCloseTo(0, 9);
    expect(isWhole(whole, view, frame)).toBe(true);
  });

  it("keeps what is under the finger where it is", () => {
    // Within a pixel of the frame, not on the border between two.
    const about = { x: 201, y: 151 };
    // As wide as it is high: nothing is beside the frame that would have to go first.
    const square = { width: 400, height: 400 };
    let viewport = fit(square, frame);
    const before = pixelAt(viewport, about, frame);
    for (let i = 0; i < 20; i += 1) viewport = zoom(viewport, 1.3, about, square, frame);
    expect(pixelAt(viewport, about, frame)).toEqual(before);
    expect(isWhole(viewport, square, frame)).toBe(false);
  });

  it("goes down to single pixels, and out to no more than the whole", () => {
    const near = zoom(fit(view, frame), 1e9, { x: 250, y: 200 }, view, frame);
    expect(near.scale).toBeGreaterThanOrEqual(32);
    const far = zoom(near, 1e-9, { x: 0, y: 0 }, view, frame);
    expect(far).toEqual(fit(view, frame));
  });

  it("never leaves a gap beside a frame that is larger than the view", () => {
    const near = zoom(fit(view, frame), 10, { x: 250, y: 200 }, view, frame);
    const corner = pan(near, 1e6, 1e6, view, frame);
    expect([corner.left, corner.top]).toEqual([0, 0]);
    const other = pan(near, -1e6, -1e6, view, frame);
    expect(other.left).toBeCloseTo(view.width - frame.width * near.scale, 9);
  });

  it("names no pixel outside the frame", () => {
    expect(pixelAt(fit(view, frame), { x: 20, y: 200 }, frame)).toBeNull();
    expect(pixelAt({ scale: 10, left: 0, top: 0 }, { x: 19.9, y: 10 }, frame)).toEqual({ x: 1, y: 1 });
  });
});
