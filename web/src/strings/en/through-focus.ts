/** A sweep through focus. */
export const throughFocus = {
  spacing: "spacing, px",
  spacingLabel: "Spacing against the axis's position, with its target and the curve fitted to it",
  eogLabel: "EOG of the central view against the axis's position, with the curve fitted about its peak",
  bestAt: (text: string) => `best focus, where the spacing meets its target: ${text}`,
  peakAt: (text: string) => `EOG greatest: ${text}`,
  best: "Best focus by the curve",
  peak: "EOG greatest",
  noCrossing: "not within the sweep, or too few positions",
  noPeak: "no peak within the sweep, or too few positions",
};
