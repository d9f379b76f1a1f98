// Was nach einem Auftrag angeboten wird, der vorzeitig geendet hat.

import type * as en from "../en/way-on";

export const wayOn: typeof en.wayOn = {
  title: "Wie es weitergeht",
  airStep: {
    holds: "Der Schritt in Luft gilt noch: Der Schritt mit Kugelschale kann daran anschließen.",
    doubtful:
      "Der Schritt in Luft gilt noch, wenn seine Tafeln dort standen, wo sie stehen sollten. Stimmen Kugelschale, Wasser und Tafel, dann in Luft neu beginnen.",
    gone: "Kein Schritt in Luft gilt mehr: Zuerst ist Δv in Luft einzustellen.",
  },
  look: "Den Prüfstand ansehen: Die Achsen stehen irgendwo, und nichts geht von selbst weiter.",
  shell:
    "Ob die Kugelschale montiert ist, ist nicht mehr bekannt; sie gilt als montiert. Bitte auf der Seite „Live“ unter „Kugelschale“ angeben.",
  resetFirst: "Der Prüfstand ist angehalten: zuerst den Halt aufheben.",
  goOn: (kind) => `Fortsetzen: ${kind}`,
  again: (kind) => `Neu beginnen: ${kind}`,
};
