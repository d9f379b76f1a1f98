// Wörter der Fokusanzeige für sich, für einen zweiten Bildschirm oder ein Telefon.

import type * as en from "../en/meter-page";

export const meterPage: typeof en.meterPage = {
  open: "Für sich",
  openMore: "Die Fokusanzeige allein, in großen Ziffern: für einen zweiten Bildschirm oder ein Telefon",
  back: "◀ Ganze Seite",
  unit: "px",
  fullScreen: "Vollbild",
  spacing: (spacing, sigma, target) => `${spacing} ± ${sigma} px, Soll ${target} px`,
  age: (seconds) => `${seconds} s alt`,
};
