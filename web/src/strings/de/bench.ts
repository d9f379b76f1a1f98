// Wörter des Prüfstands: Bedienhoheit, Achsen, Handbetrieb, Kugelschale.

import type * as en from "../en/bench";

export const lease: typeof en.lease = {
  owner: "ein Browser",
  elsewhere: (owner) => `${owner} (in einem anderen Fenster)`,
  unclear: "Wer die Bedienhoheit hat, ist nicht bekannt.",
  free: "Niemand hat die Bedienhoheit.",
  mine: (owner) => `Diese Seite hat die Bedienhoheit${owner === lease.owner ? "" : ` (${owner})`}.`,
  ranOut: "Ihre Bedienhoheit ist abgelaufen.",
  taken: (owner) => `${owner} hat Ihnen die Bedienhoheit entzogen.`,
  lostJob: "Ihr Auftrag ist damit abgebrochen.",
  lostMore: "Was Sie gedrückt hielten, ist losgelassen; was sich dadurch bewegte, steht.",
  askName: "Wie heißen Sie?",
  askNameMore: "Andere sehen den Namen, solange Sie die Bedienhoheit haben.",
  askNameKeep: "Speichern",
  askNameNot: "Ohne Namen",
  held: (owner, note) => `${owner} hat die Bedienhoheit${note ? ` (${note})` : ""}.`,
  byJob: "bis der Auftrag endet",
  left: (seconds) => `noch ${seconds} s, wenn nicht verlängert`,
  take: "Bedienhoheit übernehmen",
  release: "Bedienhoheit abgeben",
  takeOver: "Bedienhoheit entziehen…",
  takeOverSure: (owner, job) =>
    `Bedienhoheit entziehen (${owner})? ${job ? "Der laufende Auftrag wird abgebrochen. " : ""}Eine fahrende Achse wird angehalten.`,
  takeOverYes: "Entziehen",
  takeOverNo: "Belassen",
};

export const axis: typeof en.axis = {
  name: { focus: "Fokusachse", e: "e-Achse" },
  short: { focus: "Fokusachse", e: "e-Achse" },
  readbackMore: "Wo die Achse laut Steuerung steht. Δv und e selbst werden im Bild gemessen.",
  unknown: "unbekannt",
  notHomed: "nicht referenziert",
  disconnected: "nicht verbunden",
  moving: "fährt",
  wall: "Sperre",
  scale: (name, at, low, high) => `${name}: ${at}, Bereich ${low} bis ${high}`,
};

export const byHand: typeof en.byHand = {
  title: "Handbetrieb",
  home: "Ref.",
  homeMore: (axis) => `Ref. anfahren: ${axis}`,
  step: "Schritt",
  stepBy: (axis, step) => `${axis} um ${step} verfahren`,
  hold: {
    low: "Gedrückt halten: fährt zu kleineren Positionen",
    high: "Gedrückt halten: fährt zu größeren Positionen",
  },
  holdOf: (axis, hold) => `${axis}: ${hold}`,
  pace: "Halten",
  paces: { slow: "langsam", fast: "schnell" },
  moveTo: (axis, unit) => `Zielposition der ${axis}, ${unit}`,
  to: "Ziel",
  go: "Los",
  sure: (axis, from, to, by) => `${axis} um ${by} verfahren, von ${from} auf ${to}?`,
  outside: (low, high) => `Zulässig ist ${low} bis ${high}.`,
  beyond: {
    low: (axis) => `${axis} steht unterhalb des jetzt Zulässigen: Sie lässt sich nur aufwärts verfahren.`,
    high: (axis) => `${axis} steht oberhalb des jetzt Zulässigen: Sie lässt sich nur abwärts verfahren.`,
  },
  untold:
    "Solange die Kugelschale montiert oder nicht sicher abgenommen ist, fährt die e-Achse nur so nahe heran, wie ihr Nullpunkt und ihr Maßstab bekannt sind. Der Schritt mit Kugelschale einer Justage bestimmt sie; zero_uncertainty_mm und scale_uncertainty in [bench.e] sagen, wie gut sie vorher bekannt sind.",
  yes: "Verfahren",
  no: "Nicht verfahren",
  onSwitch: "Endschalter betätigt",
  leave: "Vom Endschalter wegfahren…",
  leaveMore: (axis) => `${axis} vom Endschalter wegfahren`,
  leaveSure: (axis) =>
    `${axis} ansehen: Welcher der beiden Endschalter ist betätigt? Die Achse fährt von ihm weg, höchstens 3 mm, bis er frei ist.`,
  leaveFrom: {
    low: "Der am unteren Ende",
    high: "Der am oberen Ende",
  },
  leaveNot: "Nicht fahren",
  plugFirst: (axis) => `${axis} ist nicht verbunden: zuerst nach Kabel und Strom ihrer Steuerung sehen.`,
  cameraFirst: "Die Kamera liefert keine Bilder: zuerst nach ihrem Kabel und Strom sehen.",
  cameraUnfit: (why) => `Die Bilder der Kamera werden nicht vermessen: ${why}.`,
  leaveFirst: (axis) =>
    `${axis} steht auf einem Endschalter: zuerst auf der Seite „Live“ von ihm wegfahren oder Ref. anfahren.`,
  homeFirst: (axis) =>
    `${axis} hat vor der Referenzfahrt keinen Ort: zuerst Ref. anfahren, auf der Seite „Live“ oder als Auftrag.`,
  airFirst:
    "Der Schritt mit Kugelschale setzt auf einem Schritt in Luft auf, und keiner gilt: zuerst „Nur Schritt in Luft“ oder eine gemeinsame Justage.",
  others: (owner) =>
    `${owner} hat die Bedienhoheit: Bis Sie sie haben, lässt sich von hier nichts verfahren.`,
  hint: "◀ oder ▶ gedrückt halten; beim Loslassen hält die Achse an.",
};

export const shell: typeof en.shell = {
  title: "Kugelschale",
  state: { on: "montiert", off: "abgenommen", unknown: "unbekannt" },
  sure: "Ist die Kugelschale wirklich abgenommen? Die e-Achse darf dann dorthin fahren, wo sie wäre.",
  yes: "Sie ist abgenommen",
  no: "Belassen",
};
