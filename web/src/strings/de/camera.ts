// Wörter zu Belichtungszeit und Verstärkung der Kamera und zum Histogramm.

import type * as en from "../en/camera";

export const camera: typeof en.camera = {
  title: "Kamera",
  name: { exposure: "Belichtungszeit", gain: "Verstärkung" },
  unit: { ms: "ms", factor: "×", db: "dB", driver: "" },
  field: (name, unit) => (unit === "" ? name : `${name}, ${unit}`),
  limits: (low, high, unit) => `${low} bis ${high}${unit === "" ? "" : ` ${unit}`}`,
  driverUnit: "in den Zahlen des Treibers",
  set: "Setzen",
  setMore: (name) => `${name} setzen`,
  outside: (limits) => `Möglich ist ${limits}.`,
  auto: "Automatisch belichten",
  autoMore:
    "Findet Belichtungszeit und Verstärkung für ein Weißbild an den Bildern der Kamera: vorher die Streuscheibe aufsetzen.",
  searching: "Wird gesucht…",
  found: (level, clipped, frames) =>
    `Die hellen Pixel liegen bei ${level} % von Weiß, ${clipped} % sind übersteuert, nach ${frames} ${frames === 1 ? "Bild" : "Bildern"}.`,
  leftAsItWas: "Es war richtig und bleibt, wie es war.",
  dropsWhite:
    "Eine Änderung verwirft das Weißbild, ohne das kein Schritt mit Kugelschale an einen Schritt in Luft anschließt: bis die Kamera wieder eingestellt ist wie zuvor oder ein Auftrag ein anderes aufgenommen hat.",
  none: "Diese Kamera hat weder Belichtungszeit noch Verstärkung, die sich von hier aus einstellen ließen.",
  reason: {
    job: "Ein Auftrag läuft und lässt die Kamera, wie sie eingestellt ist, bis er endet.",
    others: (owner) => `${owner} hat die Bedienhoheit: Ohne sie lässt sich von hier aus nichts einstellen.`,
    gone: "Die Kamera sendet nichts.",
    link: "Vom Dienst ist nichts zu hören.",
  },
  histogram: "Histogramm",
  histogramMore:
    "Alle Pixel des Rohbilds nach ihrem Grauwert, in voller Tiefe des Sensors; die Höhen sind logarithmisch. Rot ist übersteuert.",
  histogramNone: "Kein Bild zum Auszählen",
  histogramOf: (bits, black, clipped) =>
    `Grauwerte des neuesten Bilds, ${bits} Bit: ${black} % der Pixel schwarz, ${clipped} % an Weiß übersteuert`,
  black: (share) => `schwarz ${share} %`,
  blackMore: "Zwischen den Mikrobildern ist es dunkel: Auch in einem guten Bild sind viele Pixel schwarz.",
  clipped: (share) => `übersteuert ${share} %`,
  clippedMore:
    "Sie bekamen mehr Licht, als sie wiedergeben können: kürzer belichten oder weniger verstärken.",
  bits: (bits) => `${bits} Bit`,
};
