// What comes over the WebSocket, read once and checked for what everything else relies on.

import { fromBinary } from "@bufbuild/protobuf";
import type { components } from "./gen/api";
import { ViewedSchema, type Viewed } from "./gen/plenalign/v1/frame_pb";

type Schemas = components["schemas"];
export type ServerMessage = Schemas["ServerMessage"];
export type ViewerMessage = Schemas["ViewerMessage"];
export type Bench = Schemas["BenchView"];
export type Axis = Schemas["AxisView"];
export type AxisName = Schemas["AxisName"];
export type Job = Schemas["JobResource"];
export type JobState = Schemas["JobState"];
export type Iteration = Schemas["Iteration"];
export type Report = Schemas["Report"];
export type Measurement = Schemas["MeasurementView"];
export type ShellState = Schemas["ShellState"];
export type StopReport = Schemas["StopReport"];
export type LeaseGrant = Schemas["LeaseGrant"];
export type Problem = Pick<Schemas["Problem"], "type" | "title" | "status" | "detail">;

/** Every message type this page reads; a type not here is ignored. */
const KNOWN = [
  "snapshot",
  "gap",
  "bench",
  "job",
  "measurement",
  "tick",
  "problem",
] as const satisfies readonly ServerMessage["type"][];

/** A text message, or null for what is not one that this page knows. */
export function parseMessage(text: string): ServerMessage | null {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch {
    return null;
  }
  if (typeof value !== "object" || value === null) return null;
  const { type, seq, boot_id } = value as Record<string, unknown>;
  if (!KNOWN.some((known) => known === type)) return null;
  if (typeof seq !== "number" || typeof boot_id !== "string") return null;
  return value as ServerMessage;
}

/** A picture without its bytes: what the page says about it. */
export interface PictureFacts {
  seq: number;
  capturedAt: Date;
  /** Age when the daemon sent it, ms. */
  ageMs: number;
  focusMm: number | null;
  eMm: number | null;
  settled: boolean;
  preview: boolean;
  simulated: boolean;
  /** Of old, played from a file. */
  replayed: boolean;
  framesSkipped: number;
  widthPx: number;
  heightPx: number;
}

export interface Picture {
  jpeg: Uint8Array<ArrayBuffer>;
  facts: PictureFacts;
}

/** A binary message, or null for what is no picture. */
export function parsePicture(bytes: Uint8Array): Picture | null {
  let viewed: Viewed;
  try {
    viewed = fromBinary(ViewedSchema, bytes);
  } catch {
    return null;
  }
  if (viewed.what.case !== "frame" || viewed.what.value.jpeg.length === 0) return null;
  const frame = viewed.what.value;
  return {
    jpeg: new Uint8Array(frame.jpeg),
    facts: {
      seq: Number(frame.seq),
      capturedAt: new Date(Number(frame.capturedUnixUs) / 1000),
      ageMs: frame.ageMs,
      focusMm: frame.focusMm ?? null,
      eMm: frame.eMm ?? null,
      settled: frame.settled,
      preview: frame.preview,
      simulated: frame.simulated,
      replayed: frame.replayed,
      framesSkipped: Number(frame.framesSkipped),
      widthPx: frame.widthPx,
      heightPx: frame.heightPx,
    },
  };
}
