// Eine Messreihe durch den Fokus.

import type * as en from "../en/through-focus";

export const throughFocus: typeof en.throughFocus = {
  spacing: "Punktabstand, px",
  spacingLabel: "Punktabstand über der Stellung der Achse, mit Sollwert und angepasster Kurve",
  eogLabel: "EOG der Zentralansicht über der Stellung der Achse, mit der um den Gipfel angepassten Kurve",
  bestAt: (text) => `bester Fokus, wo der Punktabstand den Sollwert trifft: ${text}`,
  peakAt: (text) => `EOG am größten: ${text}`,
  best: "Bester Fokus nach der Kurve",
  peak: "EOG am größten",
  noCrossing: "nicht innerhalb der Messreihe, oder zu wenige Stellungen",
  noPeak: "kein Gipfel innerhalb der Messreihe, oder zu wenige Stellungen",
};
