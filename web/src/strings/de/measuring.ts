// Wörter zu dem, was im Livebild gemessen und daraus behalten wird.

import type * as en from "../en/measuring";

export const measuring: typeof en.measuring = {
  title: "Messen",
  crosshair: "Fadenkreuz",
  crosshairMore: "Linien durch die Mitte des Bilds",
  tool: {
    region: "Ausschnitt",
    ruler: "Strecke",
  },
  toolMore: {
    region: "Punktabstand und Helligkeit eines Teils: darüberziehen",
    ruler: "Zwischen zwei Pixeln: vom einen zum anderen ziehen",
  },
  keys: {
    region:
      "Ziehen zeichnet einen Ausschnitt. Pfeiltasten verschieben ihn, mit Umschalt die Ecke rechts unten; Escape beendet. Plus und Minus vergrößern und verkleinern, 0 zeigt das ganze Bild.",
    ruler:
      "Ziehen zeichnet eine Strecke. Pfeiltasten verschieben ihr Ende, mit Umschalt ihren Anfang; Escape beendet. Plus und Minus vergrößern und verkleinern, 0 zeigt das ganze Bild.",
  },
  region: (width, height, x, y) => `Ausschnitt von ${width} × ${height} px bei ${x}, ${y}`,
  spacing: (spacing, sigma) => `Punktabstand ${spacing} ± ${sigma} px allein durch Rauschen und Streuung`,
  difference: (difference) => `${difference} px vom Sollwert`,
  spacingMore:
    "Mittel über seine Mikrobilder mit der Unsicherheit aus Rauschen und Streuung um eine glatte Fläche: Damit lassen sich Ausschnitte eines Bilds vergleichen; was das ganze Bild gemeinsam hat, steht nur im ± der Fokusanzeige",
  of: (lenses, frame) => `${lenses} Mikrobilder von Bild ${frame}`,
  old: "ALT",
  spacingNone: "kein Punktabstand: zu wenige gemessene Mikrobilder darin",
  grey: (mean, least, most) => `Grauwert ${mean} im Mittel, ${least} bis ${most} von 255`,
  saturated: (percent) => `${percent} % gesättigt`,
  greyNone: "Grauwerte kommen mit dem nächsten Bild",
  distance: (px) => `Strecke ${px} px`,
  lenses: (count) => `${count} Mikrobilder`,
  along: (dx, dy) => `${dx} waagrecht, ${dy} senkrecht`,
  keep: "Behalten",
  snapshot: "Schnappschuss",
  snapshotMore: "Das Bild, wie es hier zu sehen ist, mit den Einblendungen",
  raw: "Rohbilddatei",
  rawMore: "Das neueste Bild mit den Werten der Kamera, jedes Bit davon",
  full: "Groß",
  fullMore: "Das Bild allein, auf dem ganzen Bildschirm, wo der Browser das kann",
  nothing: "Noch ist kein Bild da, das zu behalten wäre",
};
