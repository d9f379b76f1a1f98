import { create, toBinary } from "@bufbuild/protobuf";
import { describe, expect, it } from "vitest";
import { FrameSchema, ViewedSchema } from "../src/gen/plenalign/v1/frame_pb";
import { parseMessage, parsePicture } from "../src/wire";
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

describe("parsePicture", () => {
  it("reads a picture and keeps unknown positions unknown", () => {
    const frame = create(FrameSchema, {
      jpeg: new Uint8Array([0xff, 0xd8]),
      seq: 12n,
      capturedUnixUs: 1_700_000_000_123_456n,
      focusMm: -0.25,
      settled: true,
      simulated: true,
      ageMs: 31.5,
      framesSkipped: 3n,
      widthPx: 1160,
      heightPx: 1160,
      reduce: 2,
    });
    const message = create(ViewedSchema, { what: { case: "frame", value: frame } });
    const picture = parsePicture(toBinary(ViewedSchema, message));
    expect(picture?.facts).toMatchObject({
      seq: 12,
      focusMm: -0.25,
      eMm: null,
      ageMs: 31.5,
      framesSkipped: 3,
    });
    expect(picture?.facts.capturedAt.getTime()).toBeCloseTo(1_700_000_000_123.456, 0);
    expect([...(picture?.jpeg ?? [])]).toEqual([0xff, 0xd8]);
  });

  it("gives null for bytes that are no picture", () => {
    expect(parsePicture(new Uint8Array([0xff, 0xff, 0xff]))).toBeNull();
    expect(parsePicture(new Uint8Array())).toBeNull();
  });
});
