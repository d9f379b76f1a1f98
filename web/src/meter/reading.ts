// What the meter shows: the newest spacing against what it is to be, whether it was read frame by frame or measured in
// whole.

import type { Scene } from "./set-up";
import type { Combined, FrameReading, Measurement, TwoBoards } from "../daemon/wire";

/** Which way Δv or e has to go: a larger one makes the spacing smaller. "There" is where a job would accept it; "unsure" is
 *  where it cannot be told from the target, and not well enough known to be accepted; of two boards, of what may be two
 *  ("doubted"), or of a board of several levels, the spacing is none's; that of a board "elsewhere" has another target;
 *  of one that is "unasked" for it is not known where it stands; and "unsaid" is whether the shell is on, and so which target it
 *  has. */
export type Direction =
  "larger" | "smaller" | "there" | "unsure" | "two_boards" | "doubted" | NonNullable<Scene["otherwise"]>;

export interface Reading {
  /** Of one frame, as each is read while somebody looks; or of a whole measurement, of which few are made. */
  of: "frame" | "measurement";
  /** Of the frames up to the newest while nothing moved: their mean. */
  spacingPx: number;
  sigmaPx: number;
  /** How many they are. */
  frames: number;
  /** The newest frame's own. */
  single: { spacingPx: number; sigmaPx: number };
  targetPx: number;
  /** By how much it may be off that where a job accepts it. */
  tolerancePx: number;
  differencePx: number;
  direction: Direction;
  /** The two boards that are in view where one should be; null where there is one, as far as has been measured. */
  twoBoards: TwoBoards | null;
  /** Where it is in doubt, why no frame could be measured in whole to end that; else empty. */
  unresolved: string;
  /** Within the blur limit. */
  inFocus: boolean;
  /** When the picture that it is of began, the daemon's clock, ms; −∞ where it is that of the one before. */
  pictureAt: number;
  /** When a picture was taken last that was measured in whole to be of one board, and when the first began since, the daemon's
   *  clock, ms. */
  oneBoardAt: number;
  unmeasuredAt: number;
  /** Rise of the spacing, px per half frame width. */
  tiltXPx: number;
  tiltYPx: number;
  /** Pitch of the micro-images, px; null while nothing has been measured in whole. */
  pitchPx: number | null;
  focusMm: number | null;
  eMm: number | null;
  /** Whether both axes were at rest. */
  settled: boolean;
  /** When its frame was taken, the daemon's clock, ms. */
  capturedAt: number;
  /** The same on its machine's clock that nobody sets, ms; null where it is not known. */
  monotonicMs: number | null;
}

/** Why a frame newer than the newest reading has none. */
export interface Missing {
  is: "lost" | "refused";
  why: string;
  targetPx: number;
  tolerancePx: number;
  capturedAt: number;
  monotonicMs: number;
}

/** A whole measurement's spacing against its target. `monotonicMs` says of a moment, ms, which it was by the daemon's machine's
 *  clock that nobody sets. */
export function reading(
  measurement: Measurement,
  scene: Scene,
  monotonicMs: (at: number) => number | null = () => null,
): Reading {
  const { spacing } = measurement;
  const capturedAt = Date.parse(measurement.captured_at);
  return {
    of: "measurement",
    ...against(
      spacing.spacing_px,
      spacing.spacing_sigma_px,
      measurement.spacing_target_px,
      measurement.spacing_tolerance_px ?? 0,
      scene,
    ),
    frames: spacing.frames,
    single: { spacingPx: spacing.spacing_px, sigmaPx: spacing.spacing_sigma_px },
    inFocus: measurement.in_focus,
    pictureAt: -Infinity,
    oneBoardAt: -Infinity,
    unmeasuredAt: -Infinity,
    tiltXPx: spacing.tilt_x_px,
    tiltYPx: spacing.tilt_y_px,
    pitchPx: measurement.micro_image_pitch_px,
    focusMm: measurement.focus_mm ?? null,
    eMm: measurement.e_mm ?? null,
    settled: measurement.settled,
    capturedAt,
    monotonicMs: monotonicMs(capturedAt),
    ...told(measurement, false, scene),
    unresolved: "",
  };
}

/** What the meter read in a frame; what it does not know of the micro-images is from the newest whole measurement. `setUpAt`
 *  is when what is in view was set up, the daemon's clock, ms. */
export function frameReading(
  read: FrameReading,
  measurement: Measurement | null,
  scene: Scene,
  setUpAt: number,
  before: Reading | null,
): Reading | null {
  const { found, targetPx, tolerancePx, focusMm, eMm, settled, capturedAt, monotonicMs } = read;
  if (found.is !== "measured") return null;
  const { spacingPx, sigmaPx, combined, tiltXPx, tiltYPx } = found;
  const pictureAt = pictureBegan(combined, capturedAt, before);
  const measuredAt = measurement ? Date.parse(measurement.captured_at) : -Infinity;
  // Of a picture that nobody has measured in whole it is not known whether it is of one board.
  const inFocus = found.inFocus && measurement !== null && measuredAt >= Math.max(pictureAt, setUpAt);
  const pitchPx = measurement?.micro_image_pitch_px ?? null;
  return {
    of: "frame",
    ...against(combined.spacingPx, combined.sigmaPx, targetPx, tolerancePx, scene),
    frames: combined.frames,
    single: { spacingPx, sigmaPx },
    ...{ inFocus, pictureAt, tiltXPx, tiltYPx, pitchPx, focusMm, eMm, settled },
    ...{ capturedAt, monotonicMs },
    ...unmeasured(pictureAt, measurement, before),
    // What was in view before it was set up anew says nothing of what is there now.
    ...told(measuredAt >= setUpAt ? measurement : null, found.doubted, scene),
    unresolved: found.unresolved,
  };
}

/** Of what is not to be compared with the target, which it is, whatever the spacing comes to. */
function told(measurement: Measurement | null, doubted: boolean, { otherwise }: Scene) {
  const twoBoards = measurement?.two_boards ?? null;
  const several = twoBoards ? "two_boards" : doubted ? "doubted" : null;
  // What nobody has asked for may well be a board of several levels.
  const maySeveral = otherwise === "levels" || otherwise === "unasked";
  const direction: Direction | null = maySeveral ? otherwise : (several ?? otherwise);
  return { twoBoards, ...(direction && { direction, inFocus: false }) };
}

/** Whether a reading is the spacing of one board that it can be compared for, as far as is known: of no other anything is
 *  ordered. */
export function isOfOne({ direction }: Pick<Reading, "direction">): boolean {
  return !["two_boards", "doubted", "levels", "elsewhere", "unasked", "unsaid"].includes(direction);
}

/** Whether a reading is of several levels or boards at once. */
export function isOfSeveral({ direction, twoBoards }: Pick<Reading, "direction" | "twoBoards">): boolean {
  return direction === "levels" || twoBoards !== null;
}

/** Whether a reading is called in focus: within the blur limit, and where nothing is to be moved. */
export function isCalledInFocus({ direction, inFocus }: Pick<Reading, "direction" | "inFocus">): boolean {
  return inFocus && direction === "there";
}

/** A reading that is of no one board; null where it is, or there is none. */
export function ofSeveral(reading: Reading | null): Reading | null {
  return reading && !isOfOne(reading) ? reading : null;
}

/** When the picture began that frames are combined of; what moves an axis leaves it as it was. */
function pictureBegan(combined: Combined, capturedAt: number, before: Reading | null): number {
  const first = capturedAt - combined.spanMs;
  const goesOn = before?.of === "frame" && first <= before.capturedAt;
  if (goesOn || !combined.ofNewPicture) return before?.pictureAt ?? -Infinity;
  return first;
}

/** When one board was measured in whole last, and when the first picture began since. */
function unmeasured(pictureAt: number, measurement: Measurement | null, before: Reading | null) {
  const known = before?.of === "frame" ? before : null;
  const measuredAt = measurement && !measurement.two_boards ? Date.parse(measurement.captured_at) : -Infinity;
  const oneBoardAt = Math.max(known?.oneBoardAt ?? -Infinity, measuredAt);
  const goesOn = known !== null && oneBoardAt < known.unmeasuredAt;
  return { oneBoardAt, unmeasuredAt: goesOn ? known.unmeasuredAt : pictureAt };
}

/** What there is instead of a reading. A spacing once lost is lost until it is measured again: a frame that cannot be
 *  measured meanwhile only says why it is not found. */
export function missing(read: FrameReading, before: Missing | null): Missing | null {
  const { found, targetPx, tolerancePx, capturedAt, monotonicMs } = read;
  if (found.is === "measured") return null;
  const is = before?.is === "lost" ? "lost" : found.is;
  return { is, why: found.why, targetPx, tolerancePx, capturedAt, monotonicMs };
}

/** By the criterion of a job that sets e, through the shell, or Δv, in air. */
function against(
  spacingPx: number,
  sigmaPx: number,
  targetPx: number,
  tolerancePx: number,
  { inAir }: Scene,
) {
  const differencePx = spacingPx - targetPx;
  return {
    ...{ spacingPx, sigmaPx, targetPx, tolerancePx, differencePx },
    direction: directionOf(differencePx, sigmaPx, tolerancePx, inAir),
  };
}

function directionOf(differencePx: number, sigmaPx: number, tolerancePx: number, inAir: boolean): Direction {
  const off = Math.abs(differencePx);
  const accepted = inAir ? off + 2 * sigmaPx < tolerancePx : off <= tolerancePx && sigmaPx <= tolerancePx;
  if (accepted) return "there";
  if (off <= 2 * sigmaPx) return "unsure";
  return differencePx > 0 ? "larger" : "smaller";
}

/** The reading that is closest to its target as far as can be told, and where the axes stood. */
export type Best = Pick<Reading, "differencePx" | "sigmaPx" | "targetPx" | "focusMm" | "eMm" | "capturedAt">;

/** What the best begins with anew: nothing where there is no reading now, or none of one board. */
export function bestAnew({
  reading,
  missing,
}: {
  reading: Reading | null;
  missing: Missing | null;
}): Best | null {
  return reading && missing === null && isOfOne(reading) ? best(null, reading) : null;
}

/** The best so far with a new reading. Of no one board there is none: what was read since nobody has measured one in whole goes
 *  with it. */
export function bestWith(held: Best | null, now: Reading): Best | null {
  if (isOfOne(now)) return best(held, now);
  return held && held.capturedAt >= Math.max(now.unmeasuredAt, now.oneBoardAt) ? null : held;
}

/** The best so far with a new reading. Another target begins anew: what was best for the old one says nothing. Where the axes
 *  stood when a frame was exposed is known only while they stand. */
export function best(held: Best | null, now: Reading): Best {
  const { differencePx, sigmaPx, targetPx, capturedAt } = now;
  const [focusMm, eMm] = now.settled ? [now.focusMm, now.eMm] : [null, null];
  // A single frame's spacing is often nearer by chance than the mean of many: what it may be off by counts.
  const off = (one: Pick<Reading, "differencePx" | "sigmaPx">) => Math.hypot(one.differencePx, one.sigmaPx);
  const better = held?.targetPx !== targetPx || off(now) < off(held);
  return held && !better ? held : { differencePx, sigmaPx, targetPx, focusMm, eMm, capturedAt };
}
