import { create, toBinary, type MessageInitShape } from "@bufbuild/protobuf";
import { describe, expect, it } from "vitest";
import {
  CombinedSince,
  FrameSchema,
  LensState,
  Picture,
  ReadingSchema,
  ReadingState,
  SpacingMapSchema,
  ViewedSchema,
} from "../src/gen/plenalign/v1/frame_pb";
import { parseMessage, parseSeen } from "../src/daemon/wire";
import { boot } from "./fixtures";

describe("parseMessage", () => {
  it("reads a message that it knows", () => {
    const text = JSON.stringify({
      type: "tick",
      seq: 4,
      boot_id: boot,
      now: "2026-01-01T00:00:00Z",
      more: 1,
    });
    expect(parseMessage(text)).toMatchObject({ type: "tick", seq: 4, boot_id: boot });
  });

  it("gives null for what it does not know, and never throws", () => {
    const texts = ["", "{", "null", "7", "[]", "{}", '{"type":"unheard-of","seq":1,"boot_id":"x"}'];
    for (const text of [
      ...texts,
      '{"type":"bench","boot_id":"x"}',
      '{"type":"bench","seq":"1","boot_id":"x"}',
    ]) {
      expect(parseMessage(text), text).toBeNull();
    }
  });
});

describe("parseSeen", () => {
  it("reads the spacing over the field, and leaves out what is short of an entry or of a state", () => {
    const map = create(SpacingMapSchema, {
      frameSeq: 9n,
      microImagePitchPx: 29.4,
      spacingTargetPx: 19.7,
      xPx: [10, 40, 70, 100],
      yPx: [20, 20, 20, 20],
      spacingPx: [19.5, 20, 19, 19],
      sigmaPx: [0.1, Infinity, 0.3],
      state: [LensState.MATCHED, LensState.BLANK, LensState.UNSPECIFIED, LensState.MATCHED],
    });
    const seen = parseSeen(
      toBinary(ViewedSchema, create(ViewedSchema, { what: { case: "spacingMap", value: map } })),
    );
    expect(seen?.is).toBe("map");
    const lenses = seen?.is === "map" ? seen.map.lenses : [];
    expect(lenses.map((lens) => [lens.x, lens.fate])).toEqual([
      [10, "matched"],
      [40, "blank"],
    ]);
    expect(lenses[0]?.spacingPx).toBeCloseTo(19.5, 6);
    expect(seen?.is === "map" ? seen.map : null).toMatchObject({
      frameSeq: 9,
      pitchPx: 29.4,
      targetPx: 19.7,
    });
  });

  it("reads a picture and keeps unknown positions unknown", async () => {
    const frame = create(FrameSchema, {
      png: new Uint8Array([0x89, 0x50]),
      seq: 12n,
      capturedUnixUs: 1_700_000_000_123_456n,
      focusMm: -0.25,
      settled: true,
      simulated: true,
      ageMs: 31.5,
      framesSkipped: 3n,
      alike: 4,
      widthPx: 1160,
      heightPx: 1160,
      viewport: {
        xPx: 3,
        yPx: 4,
        widthPx: 50,
        heightPx: 40,
        pictureWidthPx: 50,
        pictureHeightPx: 40,
        lossless: true,
      },
    });
    const message = create(ViewedSchema, { what: { case: "frame", value: frame } });
    const seen = parseSeen(toBinary(ViewedSchema, message));
    const picture = seen?.is === "picture" ? seen.picture : null;
    expect(picture?.facts).toMatchObject({
      seq: 12,
      focusMm: -0.25,
      eMm: null,
      ageMs: 31.5,
      framesSkipped: 3,
      alike: 4,
    });
    expect(picture?.facts.capturedAt.getTime()).toBeCloseTo(1_700_000_000_123.456, 0);
    expect(picture?.facts.part).toEqual({
      x_px: 3,
      y_px: 4,
      width_px: 50,
      height_px: 40,
      picture_width_px: 50,
      picture_height_px: 40,
      lossless: true,
    });
    expect(picture?.file.type).toBe("image/png");
    expect([...new Uint8Array((await picture?.file.arrayBuffer()) ?? [])]).toEqual([0x89, 0x50]);
  });

  it("takes a picture for the whole frame where the daemon says nothing else", () => {
    const frame = create(FrameSchema, { jpeg: new Uint8Array([1]), widthPx: 101, heightPx: 80, reduce: 2 });
    const message = create(ViewedSchema, { what: { case: "frame", value: frame } });
    const seen = parseSeen(toBinary(ViewedSchema, message));
    const picture = seen?.is === "picture" ? seen.picture : null;
    expect(picture?.file.type).toBe("image/jpeg");
    expect(picture?.facts.part).toMatchObject({
      x_px: 0,
      width_px: 101,
      picture_width_px: 50,
      lossless: false,
    });
  });

  it("says what a picture shows: the raw frame where nothing is said", () => {
    const shown = (picture: Picture) => {
      const frame = create(FrameSchema, { jpeg: new Uint8Array([0xff]), picture });
      const message = create(ViewedSchema, { what: { case: "frame", value: frame } });
      const seen = parseSeen(toBinary(ViewedSchema, message));
      return seen?.is === "picture" ? seen.picture.facts.show : null;
    };
    const kinds = [Picture.UNSPECIFIED, Picture.RAW, Picture.CENTRAL, Picture.ALL_IN_FOCUS, Picture.DEPTH];
    expect(kinds.map(shown)).toEqual(["raw", "raw", "central", "all_in_focus", "depth"]);
    expect(shown(99 as Picture)).toBe("raw");
  });

  it("reads what the meter says of a frame: its spacing, or why there is none", () => {
    const of = (value: MessageInitShape<typeof ReadingSchema>) => {
      const message = create(ViewedSchema, {
        what: { case: "reading", value: create(ReadingSchema, value) },
      });
      const seen = parseSeen(toBinary(ViewedSchema, message));
      return seen?.is === "reading" ? seen.reading : null;
    };
    const measured = of({
      capturedUnixUs: 1_700_000_000_123_456n,
      capturedMonotonicUs: 5_000_250n,
      ageMs: 31.5,
      eMm: 0,
      settled: true,
      state: ReadingState.MEASURED,
      spacingPx: 19.7,
      spacingSigmaPx: 0.002,
      tiltXPx: 0.1,
      tiltYPx: -0.2,
      spacingTargetPx: 19.72,
      spacingTolerancePx: 0.016,
      inFocus: true,
      framesLeftOut: 4n,
      widthPx: 1160,
      combinedSpacingPx: 19.71,
      combinedSigmaPx: 0.0012,
      combinedFrames: 12,
      combinedSpanS: 2.5,
      combinedSince: CombinedSince.PICTURE,
      doubted: true,
      why: "the frame is too dark",
    });
    expect(measured).toEqual({
      capturedAt: 1_700_000_000_123.456,
      monotonicMs: 5000.25,
      ageMs: 31.5,
      focusMm: null,
      eMm: 0,
      settled: true,
      framesLeftOut: 4,
      widthPx: 1160,
      targetPx: 19.72,
      tolerancePx: 0.016,
      found: {
        is: "measured",
        spacingPx: 19.7,
        sigmaPx: 0.002,
        tiltXPx: 0.1,
        tiltYPx: -0.2,
        combined: { spacingPx: 19.71, sigmaPx: 0.0012, frames: 12, spanMs: 2500, ofNewPicture: true },
        inFocus: true,
        doubted: true,
        unresolved: "the frame is too dark",
      },
    });
    // Whatever but an axis ends a combination, the picture may be of something else.
    const news = [CombinedSince.START, CombinedSince.PICTURE, CombinedSince.TREND, CombinedSince.LOST];
    for (const combinedSince of [...news, CombinedSince.AXIS]) {
      const found = of({ state: ReadingState.MEASURED, combinedSince })?.found;
      const told = found?.is === "measured" ? found.combined.ofNewPicture : null;
      expect(told, CombinedSince[combinedSince]).toBe(combinedSince !== CombinedSince.AXIS);
    }
    expect(of({ state: ReadingState.LOST, why: "the board went" })?.found).toEqual({
      is: "lost",
      why: "the board went",
    });
    expect(of({ state: ReadingState.REFUSED, why: "dark" })?.found).toEqual({ is: "refused", why: "dark" });
    expect(of({})).toBeNull();
  });

  it("gives null for bytes that are no picture", () => {
    expect(parseSeen(new Uint8Array([0xff, 0xff, 0xff]))).toBeNull();
    expect(parseSeen(new Uint8Array())).toBeNull();
  });
});
