// Words of the live page: picture, focus meter, charts.

import type { Moved } from "../../meter/advice";
import type { Octant } from "../../meter/correction";
import type { Overlay, Preferences } from "../../preferences";
import type { Direction, Missing } from "../../meter/reading";
import type { Scene } from "../../meter/set-up";

export const picture = {
  live: "Live frame",
  none: "No picture yet",
  stale: (span: string) => `STALE · ${span} old`,
  same: (count: number) => `THE SAME PICTURE · ${count} times`,
  preview: "coarse, for viewing only",
  moving: "moving",
  mayMove: "perhaps moving",
  frame: (seq: number, age: string) => `frame ${seq} · ${age} old`,
  /** Of a recorded frame, whose own age is not known. */
  played: (seq: number, age: string) => `frame ${seq} · played ${age} ago`,
  rate: (perSecond: string) => `${perSecond} pictures/s`,
  skipped: (count: number) => `${count} not shown`,
  cameraOffline: "The camera sends nothing",
  zoom: "Zoom",
  scale: (times: string) => `× ${times}`,
  zoomIn: "Zoom in",
  zoomOut: "Zoom out",
  whole: "Whole",
  wholeMore: "All of the picture",
  pixels: "1:1",
  pixelsMore: "One pixel of the picture to one of the screen's",
  keys: (shown: string) => `${shown}. Plus and minus zoom, arrows move, 0 shows all of it.`,
  show: "Picture",
  shown: {
    raw: "Raw frame",
    central: "Central view",
    depth: "Depth map",
  } satisfies Record<Preferences["show"], string>,
  at: (x: number, y: number, grey: string) => `pixel ${x}, ${y}${grey}`,
  grey: (value: number) => ` · grey ${value}`,
  overlays: "Overlays",
  overlay: {
    grid: "Grid",
    pairs: "Pairs",
    error: "Spacing error",
    saturation: "Saturation",
  } satisfies Record<Overlay, string>,
  overlayMore: {
    grid: "Micro-images found: dashed without texture, crossed out where they show something else than their neighbours",
    pairs: "Neighbours that match",
    error:
      "How far each micro-image's spacing is from the target; lines of equal spacing show tilt (side by side) and curvature (rings)",
    saturation: "Pixels that got more light than they can tell",
  } satisfies Record<Overlay, string>,
  legendBelow: "smaller",
  legendAbove: "larger",
  legendRange: (px: string) => `full colour at ${px} px from the target`,
  legendLines: (px: string) => `lines every ${px} px, white on target`,
  legendLevel: "no tilt or curvature beyond the scatter",
  legendFar: "far",
  legendNear: "near",
  /** Where the distance that a colour stands for is not known. */
  legendAway: "(distance not known)",
  legendUnknown: "striped: unknown",
  mapNone: "Nothing measured to be drawn yet",
  mapOld: (frames: number) => `measured ${frames} ${frames === 1 ? "frame" : "frames"} ago`,
  saturated: (percent: string) => `${percent} % saturated`,
};

export const meter = {
  title: "Focus",
  none: "Nothing measured yet",
  noneOfThis: "Nothing read yet of what is set up now",
  /** Before the daemon has said anything. */
  unheard: "Nothing is known yet",
  noneBegin: "Begin one",
  noneMore:
    "The live picture is measured by a white frame, and there is none of the camera as it is set: an alignment begins with one.",
  unit: "px",
  sigma: (sigma: string) => `± ${sigma}`,
  target: (target: string) => `target ${target} px`,
  ago: (span: string) => `OLD · ${span}`,
  inFocus: "IN FOCUS",
  moving: "an axis moves",
  mayMove: "whether an axis moves is not known",
  tone: "Tone",
  toneMore: (key: string) =>
    `A tone for ear and hands (${key}): high where the spacing is too large, low where it is too small; pulses that come faster the nearer it is, and no break where a job would accept it`,
  rate: (perSecond: string) => `${perSecond} /s`,
  mean: (frames: number) => `mean of ${frames}`,
  leftOut: (count: number) =>
    `Readings a second, and of how many the spacing is the mean; ${count} frames left out`,
  lost: "LOST",
  /** The large figure, read aloud. */
  pixels: (px: string) => `${px} pixels`,
  noFigure: "no figure",
  missing: {
    lost: "The spacing is lost, and searched for",
    refused: "This frame cannot be measured",
  } satisfies Record<Missing["is"], string>,
  overNone: "no board stands before the lens: there is none to be read",
  overSteps: "over a board of several levels the meter may find none; a job measures them level by level",
  words: {
    larger: "Spacing too large",
    smaller: "Spacing too small",
    there: "On target",
    unsure: "Cannot be told from the target",
    two_boards: "Two boards in view",
    doubted: "In doubt",
    levels: "Several levels in view",
    elsewhere: "Board not at focus",
    unasked: "Which board?",
    unsaid: "Shell on or off?",
  } satisfies Record<Direction, string>,
  /** Within the blur limit, and yet off the target by more than the uncertainty. */
  nearly: {
    larger: "Spacing slightly too large",
    smaller: "Spacing slightly too small",
  } satisfies Partial<Record<Direction, string>>,
  thereMore: (px: string) => `Within ± ${px} px, as a job accepts it: no move is called for`,
  /** `unresolved`: why no frame could be measured in whole, where none could. */
  doubtedMore: (unresolved: string) =>
    unresolved
      ? `The spacing may be no board’s until a frame can be measured in whole; none could be: ${unresolved}`
      : "The spacing steps over the picture as between two boards, and may be neither’s, until a frame has been measured in whole",
  /** Why nothing is ordered by a spacing that is not to be compared with the target. */
  orderless: {
    levels:
      "The spacing is of none of the board's levels, and orders nothing: a job measures them level by level",
    elsewhere:
      "The board stands elsewhere than where the camera is to be focused, so that its spacing has another target: nothing is to be moved by it",
    unasked:
      "No job has asked for the board that stands there, and nothing is to be moved by it: start a job, or, once one stands at the distance of focus, say beside the axes on the page Live whether the shell is on",
    unsaid:
      "Nobody has said whether the shell is on, and the target in air is another than through it: say which beside the axes on the page Live",
  } satisfies Record<NonNullable<Scene["otherwise"]>, string>,
  unsureMore: "Within 2 σ, and too uncertain for a job to accept it",
  twoBoards: (larger: string, smaller: string, percent: string) =>
    `The spacing is ${larger} px over most of the picture and ${smaller} px over ${percent} % of it: let one board fill the picture`,
  job: "A job is under way: what moves is up to it.",
  beingSetUp: "Being set up",
  beingSetUpMore:
    "What stands before the camera is not known until it is confirmed: nothing is read until then.",
  away: (length: string) => `Move the camera ${length} away from the shell`,
  towards: (length: string) => `Move the camera ${length} towards the shell`,
  or: (length: string) => `or Δv by ${length}`,
  grow: (length: string) => `Move MLA and sensor ${length} away from the lens`,
  shrink: (length: string) => `Move MLA and sensor ${length} towards the lens`,
  otherwise: (other: string) => `, ${other} (by the design's figures)`,
  grows: { e: "Δv or e must grow", delta_v: "Δv must grow" } satisfies Record<Moved, string>,
  shrinks: { e: "Δv or e must shrink", delta_v: "Δv must shrink" } satisfies Record<Moved, string>,
  tooFar: (way: string) => `Too far from the target for a distance: ${way}`,
  /** Why nothing can be moved, or an axis cannot. */
  hindered: {
    stopped: "Nothing can be moved: the bench is stopped",
    history: "Nothing can be moved: what is done cannot be written down",
    contradicted: "Move nothing by this: the picture is not what the configuration says, as a job has found",
    out: {
      e: "The e axis cannot be moved now",
      delta_v: "The focus axis cannot be moved now",
    } satisfies Record<Moved, string>,
    onSwitch: {
      e: "A limit switch of the e axis is pressed: move it off the switch first",
      delta_v: "A limit switch of the focus axis is pressed: move it off the switch first",
    } satisfies Record<Moved, string>,
    unhomed: {
      e: "The e axis is not homed: home it first",
      delta_v: "The focus axis is not homed: home it first",
    } satisfies Record<Moved, string>,
    past: {
      e: "The e axis cannot go as far as it would have to",
      delta_v: "The focus axis cannot go as far as it would have to",
    } satisfies Record<Moved, string>,
  },
  oldMore: "This may no longer be so: wait for a newer reading before you move anything.",
  ends: { smaller: "too small", larger: "too large" },
  best: (difference: string) => `Best ${difference} px`,
  bestMore: (focus: string, e: string) => `at focus ${focus}, e ${e}`,
  bestNowhere: "read while an axis moved, or had no known place",
  bestReset: "Reset the best",
  tilt: (angle: string) => `Tilt ${angle}`,
  tiltMore: (where: string) => `the spacing grows towards the ${where}`,
  tiltNone: "none that can be told",
  tiltUntold: "Tilt not told",
  tiltUntoldMore: "a board of several levels, two boards, or none, stand before the lens",
  tiltDoubted: "what stands before the lens is in doubt",
  tiltUnknown: "what stands before the lens is not known",
  tiltUnsaid: "whether the shell is on is not known",
  below: (angle: string) => `below ${angle}`,
  tiltCaution: "between lens and MLA, if board and shell are square",
  octant: {
    right: "right",
    lowerRight: "lower right",
    bottom: "bottom",
    lowerLeft: "lower left",
    left: "left",
    upperLeft: "upper left",
    top: "top",
    upperRight: "upper right",
  } satisfies Record<Octant, string>,
  spoken: (words: string, px: string, advice: string) => `${words}, ${px}. ${advice}`,
};

export const charts = {
  title: "Last two minutes",
  spacing: "spacing, px",
  target: "target, px",
  spacingAndBand: "spacing, px, ± 2 σ",
  eog: "EOG per pixel",
  focus: (unit: string) => `focus axis, ${unit}`,
  e: (unit: string) => `e axis, ${unit}`,
  axes: (focus: string, e: string) => `${focus}, ${e}`,
  ago: (seconds: number) => `${seconds} s`,
  iteration: "iteration",
  none: "Nothing measured in the last two minutes",
  noneThen: "Nothing measured then",
  time: "Stretch of time",
  earlier: "Earlier",
  later: "Later",
  longer: "A longer stretch",
  shorter: "A shorter stretch",
  recent: "Two minutes",
  recentMore: "Back to the last two minutes",
  whole: "All",
  wholeMore: "All that this page has: from the two minutes before it was opened on",
  wholeTitle: "All that this page has",
  stretch: (from: string, to: string) => `${from} to ${to}`,
  keys: "Charts. Plus and minus zoom, left and right move, 0 shows the last two minutes.",
};
