// Was ein Auftrag von Ihnen verlangt, nach dem Namen der Aufforderung.

import type * as en from "../en/prompts";

const PROMPTS: Record<string, (value: string) => string> = {
  white_frame: () =>
    "Streuscheibe auf die Hauptlinse setzen, ohne Kugelschale, und gleichmäßig beleuchten: Ein Weißbild wird aufgenommen.",
  triple_board_in_air: (value) =>
    `Streuscheibe abnehmen, falls sie aufgesetzt ist. Ohne Kugelschale, in Luft, die drei Stufen der Dreistufentafel auf ${value} stellen, gemessen vom Hauptpunkt der Hauptlinse.`,
  board_in_air: (value) =>
    `Streuscheibe abnehmen, falls sie aufgesetzt ist. Ohne Kugelschale, in Luft, eine ebene Tafel auf ${value} stellen, gemessen vom Hauptpunkt der Hauptlinse.`,
  aperture: (value) => `Blende einstellen: ${value} am Blendenring (nicht die wirksame Blendenzahl).`,
  shell_and_water: (value) =>
    `Streuscheibe abnehmen, falls sie aufgesetzt ist. Kugelschale montieren, Becken füllen und die ebene Tafel auf ${value} stellen, gemessen vom äußeren Scheitel der Kugelschale.`,
  board_in_water: (value) =>
    `Streuscheibe abnehmen, falls sie aufgesetzt ist. Mit montierter Kugelschale und vollem Becken die ebene Tafel auf ${value} stellen, gemessen vom äußeren Scheitel der Kugelschale.`,
  least_e_by_hand: (value) =>
    `Der Motor der e-Achse ist aus. Kugelschale montieren, Becken füllen, die ebene Tafel auf ${value} stellen, gemessen vom äußeren Scheitel der Kugelschale, und die Kamera von Hand so nah an die Kugelschale schieben, wie es die Fassung der Hauptlinse zulässt.`,
  shell_off: () => "Kugelschale abnehmen und Becken wegstellen; beide Achsen fahren danach neu auf Referenz.",
};

export const prompt: typeof en.prompt = (name, value) => PROMPTS[name]?.(value) ?? null;
