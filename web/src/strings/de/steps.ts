// Wörter zu den Schritten eines Auftrags: was aufgebaut wird, in welcher Folge, und wie lange es dauert.

import type * as en from "../en/steps";

const names: Record<string, string> = {
  homing: "Referenzfahrt",
  preparation: "Geräte, und Referenzfahrt, wo nötig",
  measuring: "Messen",
  white_frame: "Streuscheibe aufsetzen",
  triple_board_in_air: "Dreistufentafel in Luft",
  board_in_air: "Ebene Tafel in Luft",
  aperture: "Blende einstellen",
  least_e_by_hand: "Kugelschale montieren, Becken füllen, Kamera von Hand an die Kugelschale schieben",
  shell_off: "Kugelschale abnehmen, Becken wegstellen",
  shell_and_water: "Kugelschale montieren, Becken füllen, Tafel ins Wasser",
  board_in_water: "Tafel ins Wasser",
};

export const steps: typeof en.steps = {
  title: "Schritte",
  summary: (count) => `Schritte und ihre Dauer: ${count}`,
  name: (name) => names[name] ?? name.replaceAll("_", " "),
  state: {
    done: "erledigt",
    now: "jetzt",
    next: "danach",
    repeated: "unten erneut verlangt: zählt nicht mehr",
  },
  ended: { now: "nicht fertig", next: "nicht erreicht" },
  you: (text) => `Bedienung ${text}`,
  bench: (text) => `Prüfstand ${text}`,
  repeats: (number) => `Schritt ${number} noch einmal`,
  numbered: (number) => `Nr. ${number}`,
  again: "Wiederholen…",
  againWhat: (name) => `Wiederholen…: ${name}`,
  againSure: {
    white_frame:
      "Weißbild noch einmal aufnehmen? Was in Luft damit gemessen wurde, wird neu gemessen; von da an geht der Auftrag weiter.",
    other:
      "Tafel noch einmal aufstellen? Ab da wird in Luft neu gemessen; das Weißbild und eine schon eingestellte Blende bleiben.",
  },
  againYes: "Wiederholen",
  againNo: "So lassen",
};

export const setUp: typeof en.setUp = {
  diffuser: "Streuscheibe",
  water: "Wasser",
  drawing: {
    diffuser: () => "Eine Streuscheibe auf der Hauptlinse, von vorn gleichmäßig beleuchtet",
    boards_in_air: (at, levels) =>
      levels > 1
        ? `In Luft, die Stufen der Tafel ${at} vom Hauptpunkt der Hauptlinse`
        : `In Luft, eine ebene Tafel ${at} vom Hauptpunkt der Hauptlinse`,
    aperture: (diameter, ring) => `Die Blende ${diameter} weit offen, f/${ring} am Ring`,
    board_in_water: (at) =>
      `Die Kugelschale auf der Kamera, das Becken voll, eine ebene Tafel ${at} vom äußeren Scheitel der Kugelschale`,
    least_e: (at) =>
      `Die Kugelschale montiert, das Becken voll, eine ebene Tafel ${at} vom äußeren Scheitel der Kugelschale; die Kamera von Hand an die Kugelschale geschoben`,
    shell_off: () => "Die Kugelschale abgenommen, das Becken weg",
  },
  ring: (number) => `f/${number}`,
};
