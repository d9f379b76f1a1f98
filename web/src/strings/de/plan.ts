// Was eine Justage tun wird, bevor sie beginnt.

import type * as en from "../en/plan";

export const plan: typeof en.plan = {
  impossible: "Diese Kamera lässt sich so, wie sie konfiguriert ist, nicht justieren:",
  obstacle: (value, needed, why) => `ist ${value} und müsste ${needed} sein: ${why}`,
  summary: (steps, seconds) =>
    `${steps === 1 ? "Ein Handgriff" : `${steps} Handgriffe`} für Sie, mehr, wo ein Bild zu wiederholen ist; dazu etwa ${Math.round(seconds)} s`,
  mounted: (e, spacing) => `Die Kugelschale wird bei e = ${e} montiert, wo der Punktabstand ${spacing} ist.`,
  held: (e) => `e wird bei ${e} gehalten, wenn Sie kein anderes nennen; dafür gilt der Plan.`,
  above: (e, tolerance, more) =>
    `e kommt auf ${e} ± ${tolerance}, oder bis zu ${more} mehr, wo die Sperre die Achse nicht weiter lässt.`,
  expected: (spacing, deltaV, e) =>
    `Erwartete Unsicherheit: ${spacing}, das sind ${deltaV} bei Δv und ${e} bei e, nach Bild und Achsen allein:`,
  byBudget: (deltaV, e) => `Mit allem, was vorausgesetzt wird, ist Δv auf ${deltaV} bekannt und e auf ${e}.`,
  heldOff: (more) =>
    `e bleibt ${more} weiter von der Kugelschale weg als gewünscht: Drei dieser Unsicherheiten liegen zwischen der Hauptlinse und der Stelle, an der sie die Kugelschale berührt.`,
};
