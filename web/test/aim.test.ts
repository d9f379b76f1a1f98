import { describe, expect, it } from "vitest";
import { COARSE, EVERY, instead, partSeen, sameAim } from "../src/daemon/aim";
import { fit, pan, zoom } from "../src/picture/viewport";

const view = { width: 500, height: 400 };
const frame = { width: 4096, height: 3072 };
const middle = { x: 250, y: 200 };

describe("what is asked for of the raw frame", () => {
  it("is the whole of it at as many pixels as the screen has", () => {
    expect(partSeen(fit(view, frame), view, frame)).toEqual({
      x_px: 0,
      y_px: 0,
      width_px: 4096,
      height_px: 3072,
      picture_width_px: 500,
      picture_height_px: 375,
      lossless: false,
    });
  });

  it("is what is seen, and costs no more than the screen has pixels, however near and wherever one looks", () => {
    for (const factor of [1.3, 5, 20, 60, 1e9]) {
      for (const [dx, dy] of [
        [0, 0],
        [37, -11],
        [1e6, 1e6],
        [-1e6, -1e6],
      ] as const) {
        const viewport = pan(zoom(fit(view, frame), factor, middle, view, frame), dx, dy, view, frame);
        const part = partSeen(viewport, view, frame);
        const { scale, left, top } = viewport;
        // All of the view is covered, and nothing beside it that a pixel is not in part within.
        expect(left + part.x_px * scale).toBeLessThanOrEqual(1e-6);
        expect(left + (part.x_px + part.width_px) * scale).toBeGreaterThanOrEqual(view.width - 1e-6);
        expect(top + (part.y_px + 1) * scale).toBeGreaterThan(-1e-6);
        expect(part.x_px + part.width_px).toBeLessThanOrEqual(frame.width);
        expect(part.y_px + part.height_px).toBeLessThanOrEqual(frame.height);
        const most = (view.width + 2 * Math.max(1, scale)) * (view.height + 2 * Math.max(1, scale));
        expect(part.picture_width_px * part.picture_height_px).toBeLessThanOrEqual(most);
        expect(part.lossless).toBe(scale >= 2);
        if (part.lossless) expect(part.picture_width_px).toBe(part.width_px);
      }
    }
  });

  it("is told from another, and replaced by the whole frame, no coarser, where it cannot be had", () => {
    const viewport = partSeen(fit(view, frame), view, frame);
    expect(sameAim({ viewport }, { viewport: { ...viewport } })).toBe(true);
    expect(sameAim({ viewport }, { viewport: { ...viewport, y_px: 1 } })).toBe(false);
    expect([sameAim(COARSE, { ...COARSE }), sameAim(COARSE, EVERY), sameAim(EVERY, { viewport })]).toEqual([
      true,
      false,
      false,
    ]);
    const of = (picture_width_px: number) => instead({ viewport: { ...viewport, picture_width_px } });
    expect([of(500), of(1500), of(3000)]).toEqual([{ reduce: 4 }, { reduce: 2 }, { reduce: 1 }]);
    expect(instead(EVERY)).toBe(EVERY);
  });
});
