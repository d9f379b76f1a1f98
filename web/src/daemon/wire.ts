// What comes over the WebSocket, read once and checked for what everything else relies on.

import { fromBinary } from "@bufbuild/protobuf";
import type { components } from "../gen/api";
import {
  CombinedSince,
  LensState,
  Picture as Pictured,
  ReadingState,
  ViewedSchema,
  type Frame,
  type Reading as FrameRead,
  type SpacingMap,
  type Viewed,
  type Viewport,
} from "../gen/plenalign/v1/frame_pb";

type Schemas = components["schemas"];
export type ServerMessage = Schemas["ServerMessage"];
export type ViewerMessage = Schemas["ViewerMessage"];
export type Bench = Schemas["BenchView"];
export type Axis = Schemas["AxisView"];
export type AxisName = Schemas["AxisName"];
export type Job = Schemas["JobResource"];
export type JobState = Schemas["JobState"];
export type OperatorStep = Schemas["OperatorStep"];
export type Iteration = Schemas["Iteration"];
export type Report = Schemas["Report"];
export type Budget = Schemas["Budget"];
export type TimeSpent = Schemas["TimeSpent"];
export type Measurement = Schemas["MeasurementView"];
export type TwoBoards = Schemas["TwoBoardsView"];
export type Recent = Schemas["RecentView"];
export type ShellState = Schemas["ShellState"];
export type StopReport = Schemas["StopReport"];
export type StopReset = Schemas["StopReset"];
export type Lease = Schemas["LeaseView"];
export type Side = Schemas["Side"];
export type Scope = Schemas["Scope"];
export type Show = Schemas["Show"];
/** A part of the raw frame, and the pixels of a picture of it. */
export type Part = Required<Schemas["Viewport"]>;
export type Design = Schemas["DesignView"];
export type Draft = Schemas["DraftView"];
export type Plan = Schemas["PlanView"];
export type DraftBase = Schemas["DraftBase"];
export type DraftState = Schemas["DraftStateView"];
export type DraftStateName = Schemas["DraftStateName"];
export type JobKind = Schemas["JobKind"];
export type JobStep = Schemas["JobStep"];
export type StepState = Schemas["StepState"];
export type Setup = Schemas["Setup"];
export type FittedPlace = Schemas["FittedPlace"];
export type JobCreated = Schemas["JobCreated"];
export type ConfirmKeyGrant = Schemas["ConfirmKeyGrant"];
export type JobRequest = Schemas["JobRequest"];
export type JobItem = Schemas["JobItem"];
export type Recording = Schemas["Recording"];
export type JobList = Schemas["JobList"];
export type Outcome = Schemas["Outcome"];
export type ConfigView = Schemas["ConfigView"];
export type ConfigCheck = Schemas["ConfigCheck"];
export type ConfigFault = Schemas["ConfigFault"];
export type ConfigWritten = Schemas["ConfigWritten"];
export type Devices = Schemas["DevicesFound"];
export type Faults = Schemas["Faults"];
export type FaultPlan = Schemas["FaultPlan"];
export type FaultPlanInForce = Schemas["PlanInForce"];
/** Some of what goes wrong, part by part. */
export type FaultsChange = { [Part in keyof Faults]?: Partial<Faults[Part]> };
export type Light = Schemas["LightView"];
export type LightControl = Schemas["LightControl"];
export type ControlName = Schemas["ControlName"];
export type AutoExposure = Schemas["AutoExposureView"];
export type Histogram = Schemas["HistogramView"];
export type AuditList = Schemas["AuditList"];
export type AuditEntry = AuditList["entries"][number];
export type Token = Schemas["TokenView"];
export type TokenList = Schemas["TokenList"];
export type TokenRequest = Schemas["TokenRequest"];
export type NewToken = Schemas["NewToken"];
export type LeaseGrant = Schemas["LeaseGrant"];
export type Session = Schemas["SessionView"];
export type Problem = Pick<Schemas["Problem"], "type" | "title" | "status" | "detail"> & {
  /** What is wrong, key by key, where the kind has that. */
  problems?: ConfigFault[];
  /** Which axis it is of, where it is of one. */
  axis?: AxisName;
};

/** Why a token opens nothing any more. */
export type Ended = Schemas["EndedView"];

/** Every message type this page reads; a type not here is ignored. */
const KNOWN = [
  "snapshot",
  "gap",
  "bench",
  "job",
  "measurement",
  "tick",
  "clock",
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
  /** The same on the daemon's machine's clock that nobody sets, ms. */
  monotonicMs: number;
  /** Age when the daemon sent it, ms. */
  ageMs: number;
  focusMm: number | null;
  eMm: number | null;
  settled: boolean;
  preview: boolean;
  simulated: boolean;
  /** Recorded earlier, and played from a file. */
  replayed: boolean;
  framesSkipped: number;
  /** How many pictures in a row are of frames that are the same to the last pixel, this one counted. */
  alike: number;
  widthPx: number;
  heightPx: number;
  /** What of the raw frame it shows; null where it shows something else. */
  part: Part | null;
  show: Show;
  /** Distances that the colours of a depth map end at, mm; null where they are not known. */
  nearMm: number | null;
  farMm: number | null;
}

export interface Picture {
  /** A JPEG, or a PNG where it is without loss. */
  file: Blob;
  facts: PictureFacts;
}

export type LensFate = "matched" | "mismatched" | "blank";

/** A micro-image and what was measured of it. */
export interface Lens {
  /** Raw pixels, 0 at the middle of the first one. */
  x: number;
  y: number;
  spacingPx: number;
  sigmaPx: number;
  fate: LensFate;
}

/** The spacing over the field. */
export interface FieldMap {
  frameSeq: number;
  pitchPx: number;
  targetPx: number;
  lenses: Lens[];
}

/** What the meter says of one frame. */
export interface FrameReading {
  /** When its exposure ended, the daemon's clock, ms. */
  capturedAt: number;
  /** The same on its machine's clock that nobody sets, ms. */
  monotonicMs: number;
  /** Age when the daemon sent it, ms. */
  ageMs: number;
  focusMm: number | null;
  eMm: number | null;
  settled: boolean;
  /** Frames that were not measured. */
  framesLeftOut: number;
  /** Columns of the raw frame. */
  widthPx: number;
  targetPx: number;
  /** By how much the spacing may be off that where a job accepts it. */
  tolerancePx: number;
  found: Found;
}

/** Frames combined while nothing moved. */
export interface Combined {
  /** Their mean. */
  spacingPx: number;
  sigmaPx: number;
  /** How many they are. */
  frames: number;
  /** From the first to the newest. */
  spanMs: number;
  /** Whether they began because the picture was another one, and not because an axis moved. */
  ofNewPicture: boolean;
}

/** A spacing that leaps or shows a trend while no axis moves does so because something else has: what is in view, or a screw. */
const NEW_PICTURE = [CombinedSince.START, CombinedSince.PICTURE, CombinedSince.TREND, CombinedSince.LOST];

/** Its spacing; or why there is none: it is lost and searched for, or the frame cannot be measured. */
export type Found =
  | {
      is: "measured";
      spacingPx: number;
      sigmaPx: number;
      tiltXPx: number;
      tiltYPx: number;
      /** Of the frames up to this one while nothing moved: their mean, and how many they are. */
      combined: Combined;
      /** Whether that is within the blur limit. */
      inFocus: boolean;
      /** Whether it steps over the field as between two boards, and nothing measured in whole says yet whether there are. */
      doubted: boolean;
      /** Of one in doubt, why no frame could be measured in whole to end that; else empty. */
      unresolved: string;
    }
  | { is: "lost" | "refused"; why: string };

/** What a binary message shows. */
export type Seen =
  | { is: "picture"; picture: Picture }
  | { is: "map"; map: FieldMap }
  | { is: "reading"; reading: FrameReading };

/** A binary message, or null for what is none of those known. */
export function parseSeen(bytes: Uint8Array): Seen | null {
  let viewed: Viewed;
  try {
    viewed = fromBinary(ViewedSchema, bytes);
  } catch {
    return null;
  }
  switch (viewed.what.case) {
    case "frame":
      return viewed.what.value.jpeg.length + viewed.what.value.png.length > 0
        ? { is: "picture", picture: pictureOf(viewed.what.value) }
        : null;
    case "spacingMap":
      return { is: "map", map: mapOf(viewed.what.value) };
    case "reading": {
      const reading = readingOf(viewed.what.value);
      return reading && { is: "reading", reading };
    }
    default:
      return null;
  }
}

const FATES: Partial<Record<LensState, LensFate>> = {
  [LensState.MATCHED]: "matched",
  [LensState.MISMATCHED]: "mismatched",
  [LensState.BLANK]: "blank",
};

/** What is not here is the raw frame: a daemon that does not say knows no other. */
const SHOWN: Partial<Record<Pictured, Show>> = {
  [Pictured.RAW]: "raw",
  [Pictured.CENTRAL]: "central",
  [Pictured.ALL_IN_FOCUS]: "all_in_focus",
  [Pictured.DEPTH]: "depth",
};

function mapOf(map: SpacingMap): FieldMap {
  const lenses: Lens[] = [];
  map.xPx.forEach((x, index) => {
    const [y, spacingPx, sigmaPx] = [map.yPx[index], map.spacingPx[index], map.sigmaPx[index]];
    const fate = FATES[map.state[index] ?? LensState.UNSPECIFIED];
    // The lists run together; what is short of an entry is left out rather than guessed.
    if (y === undefined || spacingPx === undefined || sigmaPx === undefined || fate === undefined) return;
    lenses.push({ x, y, spacingPx, sigmaPx, fate });
  });
  return {
    frameSeq: Number(map.frameSeq),
    pitchPx: map.microImagePitchPx,
    targetPx: map.spacingTargetPx,
    lenses,
  };
}

function readingOf(read: FrameRead): FrameReading | null {
  const found = foundIn(read);
  return (
    found && {
      capturedAt: Number(read.capturedUnixUs) / 1000,
      monotonicMs: Number(read.capturedMonotonicUs) / 1000,
      ageMs: read.ageMs,
      focusMm: read.focusMm ?? null,
      eMm: read.eMm ?? null,
      settled: read.settled,
      framesLeftOut: Number(read.framesLeftOut),
      widthPx: read.widthPx,
      targetPx: read.spacingTargetPx,
      tolerancePx: read.spacingTolerancePx,
      found,
    }
  );
}

function foundIn(read: FrameRead): Found | null {
  switch (read.state) {
    case ReadingState.MEASURED:
      return {
        is: "measured",
        spacingPx: read.spacingPx,
        sigmaPx: read.spacingSigmaPx,
        tiltXPx: read.tiltXPx,
        tiltYPx: read.tiltYPx,
        combined: {
          spacingPx: read.combinedSpacingPx,
          sigmaPx: read.combinedSigmaPx,
          frames: read.combinedFrames,
          spanMs: 1000 * read.combinedSpanS,
          ofNewPicture: NEW_PICTURE.includes(read.combinedSince),
        },
        inFocus: read.inFocus,
        doubted: read.doubted,
        unresolved: read.why,
      };
    case ReadingState.LOST:
      return { is: "lost", why: read.why };
    case ReadingState.REFUSED:
      return { is: "refused", why: read.why };
    default:
      return null;
  }
}

/** A daemon that says nothing of it sends the whole frame. */
function partOf(viewport: Viewport | undefined, frame: Frame): Part {
  const { widthPx, heightPx, reduce } = frame;
  return {
    x_px: viewport?.xPx ?? 0,
    y_px: viewport?.yPx ?? 0,
    width_px: viewport?.widthPx ?? widthPx,
    height_px: viewport?.heightPx ?? heightPx,
    picture_width_px: viewport?.pictureWidthPx ?? Math.floor(widthPx / Math.max(1, reduce)),
    picture_height_px: viewport?.pictureHeightPx ?? Math.floor(heightPx / Math.max(1, reduce)),
    lossless: viewport?.lossless ?? false,
  };
}

function pictureOf(frame: Frame): Picture {
  const show = SHOWN[frame.picture] ?? "raw";
  const lossless = frame.png.length > 0;
  const bytes = new Uint8Array(lossless ? frame.png : frame.jpeg);
  return {
    file: new Blob([bytes], { type: lossless ? "image/png" : "image/jpeg" }),
    facts: {
      seq: Number(frame.seq),
      capturedAt: new Date(Number(frame.capturedUnixUs) / 1000),
      monotonicMs: Number(frame.capturedMonotonicUs) / 1000,
      ageMs: frame.ageMs,
      focusMm: frame.focusMm ?? null,
      eMm: frame.eMm ?? null,
      settled: frame.settled,
      preview: frame.preview,
      simulated: frame.simulated,
      replayed: frame.replayed,
      framesSkipped: Number(frame.framesSkipped),
      alike: Math.max(1, frame.alike),
      widthPx: frame.widthPx,
      heightPx: frame.heightPx,
      part: show === "raw" ? partOf(frame.viewport, frame) : null,
      show,
      nearMm: frame.nearMm ?? null,
      farMm: frame.farMm ?? null,
    },
  };
}
