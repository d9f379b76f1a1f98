// Wörter der Seite „Verlauf“.

import type * as en from "../en/history";

export const history: typeof en.history = {
  title: "Verlauf",
  startedBy: (owner) => `gestartet: ${owner}`,
  search: "Suchen",
  searchMore: "Notiz, Name, Grund, Protokoll oder Kennung",
  kind: "Art",
  state: "Zustand",
  any: "alle",
  since: "Von",
  until: "Bis",
  none: "Kein Auftrag passt.",
  more: "Mehr anzeigen",
  when: "Wann",
  what: "Was",
  simulated: "simulierter Prüfstand",
  outcome: "Ausgang",
  iterations: "Iterationen",
  iterationsOf: (count) => `${count} ${count === 1 ? "Iteration" : "Iterationen"}`,
  measure: "Erreicht",
  files: "Dateien",
  compare: "Vergleichen",
  compareThis: (what) => `Vergleichen: ${what}`,
  compareMore: "Bis zu zwei Aufträge auswählen, um sie in einem Diagramm zu sehen.",
  compareTitle: (runs) =>
    runs < 2 ? "Ein Lauf: zum Vergleichen einen zweiten auswählen" : "Zwei Läufe in einem Diagramm",
  clear: "Leeren",
  first: "erster Lauf, px",
  second: "zweiter Lauf, px",
  difference: "Punktabstand − Soll, px",
  missing: "Aufträge früherer Läufe fehlen",
};
