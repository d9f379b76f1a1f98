// Words of the camera's exposure and gain, and of the histogram.

import type { ControlName, LightControl } from "../../daemon/wire";

export const camera = {
  title: "Camera",
  name: { exposure: "Exposure", gain: "Gain" } satisfies Record<ControlName, string>,
  unit: { ms: "ms", factor: "×", db: "dB", driver: "" } satisfies Record<LightControl["unit"], string>,
  field: (name: string, unit: string) => (unit === "" ? name : `${name}, ${unit}`),
  limits: (low: string, high: string, unit: string) => `${low} to ${high}${unit === "" ? "" : ` ${unit}`}`,
  driverUnit: "the driver’s own numbers",
  set: "Set",
  setMore: (name: string) => `Set the ${name.toLowerCase()}`,
  outside: (limits: string) => `It may be ${limits}.`,
  auto: "Auto exposure",
  autoMore:
    "Finds exposure and gain for a white frame by the camera’s own pictures: put the diffuser on the lens first.",
  searching: "Searching…",
  found: (level: string, clipped: string, frames: number) =>
    `The bright pixels are at ${level} % of white, ${clipped} % are clipped, after ${frames} ${frames === 1 ? "frame" : "frames"}.`,
  leftAsItWas: "It was right, and is left as it was.",
  dropsWhite:
    "A change drops the white frame, without which no shell step goes on from an air step: until the camera is set back, or a job has taken another.",
  none: "This camera has no exposure and no gain that can be set from here.",
  reason: {
    job: "A job is under way and keeps the camera as it is set, until its end.",
    others: (owner: string) => `${owner} has control: nothing can be set from here until you have it.`,
    gone: "The camera sends nothing.",
    link: "The daemon is not heard.",
  },
  histogram: "Histogram",
  histogramMore:
    "All pixels of the raw frame by their grey level, at the sensor’s full depth; heights are logarithmic. Red is clipped.",
  histogramNone: "No frame to be counted",
  histogramOf: (bits: number, black: string, clipped: string) =>
    `Grey levels of the newest frame, ${bits} bits: ${black} % of the pixels at black, ${clipped} % clipped at white`,
  black: (share: string) => `at black ${share} %`,
  blackMore: "Between the micro-images it is dark: many pixels are at black in a good frame, too.",
  clipped: (share: string) => `clipped ${share} %`,
  clippedMore: "They got more light than they can tell: shorten the exposure, or lower the gain.",
  bits: (bits: number) => `${bits} bits`,
};
