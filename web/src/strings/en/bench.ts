// Words of the bench: lease, axes, moves by hand, shell.

import type { AxisName, ShellState, Side } from "../../daemon/wire";

export const lease = {
  owner: "a browser",
  elsewhere: (owner: string) => `${owner} (in another window)`,
  unclear: "Who has control is not known.",
  free: "Nobody has control.",
  mine: (owner: string) => `This page has control${owner === lease.owner ? "" : `, as ${owner}`}.`,
  ranOut: "Your control has ended.",
  taken: (owner: string) => `${owner} has taken control from you.`,
  lostJob: "The job that you had started was cancelled by that.",
  lostMore: "Whatever you held down has been let go of, and what it moved has stopped.",
  askName: "What is your name?",
  askNameMore: "Others are shown it while you have control.",
  askNameKeep: "Keep it",
  askNameNot: "No name",
  held: (owner: string, note?: string | null) => `${owner} has control${note ? ` (${note})` : ""}.`,
  byJob: "until the job ends",
  left: (seconds: number) => `for ${seconds} s unless renewed`,
  take: "Take control",
  release: "Release control",
  takeOver: "Take over…",
  takeOverSure: (owner: string, job: boolean) =>
    `Take control from ${owner}? ${job ? "The job under way is cancelled. " : ""}An axis that moves is stopped.`,
  takeOverYes: "Take over",
  takeOverNo: "Leave it",
};

export const axis = {
  name: { focus: "Focus axis", e: "e axis" } satisfies Record<AxisName, string>,
  short: { focus: "focus", e: "e" } satisfies Record<AxisName, string>,
  readbackMore: "Where the controller says the axis stands. Δv and e themselves are measured in the picture.",
  unknown: "unknown",
  notHomed: "not homed",
  disconnected: "not connected",
  moving: "moving",
  wall: "wall",
  scale: (name: string, at: string, low: string, high: string) =>
    `${name} at ${at}, within ${low} to ${high}`,
};

export const byHand = {
  title: "By hand",
  home: "Home",
  homeMore: (axis: string) => `Home the ${axis} axis`,
  step: "Step",
  stepBy: (axis: string, step: string) => `Move the ${axis} axis by ${step}`,
  hold: {
    low: "Hold to move towards smaller positions",
    high: "Hold to move towards larger positions",
  } satisfies Record<Side, string>,
  holdOf: (axis: string, hold: string) => `${axis} axis: ${hold}`,
  pace: "Hold at",
  paces: { slow: "slow", fast: "fast" },
  moveTo: (axis: string, unit: string) => `Move the ${axis} axis to, ${unit}`,
  to: "Go to",
  go: "Go",
  sure: (axis: string, from: string, to: string, by: string) =>
    `Move the ${axis} axis by ${by}, from ${from} to ${to}?`,
  outside: (low: string, high: string) => `It may go from ${low} to ${high}.`,
  beyond: {
    low: (axis: string) => `The ${axis} axis stands below where it may go now: it can only be moved up.`,
    high: (axis: string) => `The ${axis} axis stands above where it may go now: it can only be moved down.`,
  } satisfies Record<Side, (axis: string) => string>,
  untold:
    "With the shell on, or not known to be off, it goes no nearer than the zero and scale of the e axis are known. An alignment’s shell step tells them; zero_uncertainty_mm and scale_uncertainty in [bench.e] say how well they are known before one.",
  yes: "Move",
  no: "Don’t",
  onSwitch: "limit switch pressed",
  leave: "Move off the switch…",
  leaveMore: (axis: string) => `Move the ${axis} axis off its limit switch`,
  leaveSure: (axis: string) =>
    `Look at the ${axis} axis: which of its two limit switches is pressed? It moves away from that one, 3 mm at most, until the switch lets go.`,
  leaveFrom: {
    low: "The one at the low end",
    high: "The one at the high end",
  } satisfies Record<Side, string>,
  leaveNot: "Don’t move",
  plugFirst: (axis: string) =>
    `The ${axis} axis is not connected: see to its cable and its controller’s power first.`,
  cameraFirst: "The camera gives no pictures: see to its cable and its power first.",
  cameraUnfit: (why: string) => `The camera’s frames are not measured: ${why}.`,
  leaveFirst: (axis: string) =>
    `The ${axis} axis stands on a limit switch: move it off, or home it, on the page Live first.`,
  homeFirst: (axis: string) =>
    `The ${axis} axis has no place before it is homed: home it first, on the page Live or as a job.`,
  airFirst:
    "The shell step goes on from an air step, and none holds: run Air step only, or a joint alignment.",
  others: (owner: string) => `${owner} has control: nothing can be moved from here until you have it.`,
  hint: "Press and hold ◀ or ▶; letting go stops the axis.",
};

export const shell = {
  title: "Shell",
  state: { on: "on", off: "off", unknown: "unknown" } satisfies Record<ShellState, string>,
  sure: "Is the shell really off the camera? The e axis may then move where the shell would be.",
  yes: "It is off",
  no: "Leave it",
};
