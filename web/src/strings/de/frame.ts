// Wörter des Rahmens: Hinweise, Verbindung, Halt, Anmeldung.

import type * as en from "../en/frame";

export const frame: typeof en.frame = {
  title: "Plenalign",
  windowTitle: (page, simulated, replayed, first) => {
    const says = {
      yours: "● Sie sind dran · ",
      operators: "● Die Bedienung ist dran · ",
      lost: "VERBINDUNG UNTERBROCHEN · ",
    };
    return `${first ? says[first] : ""}${simulated ? "SIMULIERT · " : ""}${replayed ? "WIEDERGABE · " : ""}${page} · Plenalign`;
  },
  simulated: "SIMULIERTER PRÜFSTAND",
  simulatedMore: "Keine Hardware angeschlossen: Jedes Bild und jede Zahl hier ist berechnet.",
  simulatedAxes: "Keine Achse angeschlossen: Wo sie stehen, ist berechnet.",
  replay: "WIEDERGABE",
  replayMore: "Alte Bilder aus Dateien: Nichts davon ist von jetzt.",
  connecting: "Verbindung wird aufgebaut…",
  lost: "VERBINDUNG UNTERBROCHEN",
  lostMore: "Was unten steht, ist alt. STOP kommt womöglich nicht an: den Not-Halt am Prüfstand betätigen.",
  old: (span) => `ALT · ${span}`,
  retryIn: (span) => `Neuer Versuch in ${span}`,
  retrying: "Neuer Versuch…",
  retryNow: "Jetzt versuchen",
  cameraGone: "Die Kamera ist weg",
  cameraGoneMore: "Sie sendet nichts.",
  cameraFrozen: "Die Kamera liefert ein altes Bild noch einmal",
  cameraFrozenMore: "Was zu sehen ist, ist nicht von jetzt: Stecken Sie sie ab und wieder an.",
  stageGone: (axes) => `Nicht verbunden: ${axes.join(", ")}`,
  stageGoneMore: "Nichts lässt sich verfahren.",
  noAnswer: "Der Dienst antwortet nicht",
  noAnswerInTime: "rechtzeitig kam keine Antwort",
  noConnection: "zu ihm gibt es keine Verbindung",
  dismiss: "Ausblenden",
  close: "Schließen",
  historyFault: "Nichts lässt sich verfahren",
  viewOnly: "Sie dürfen zusehen und anhalten; für Befehle braucht es ein Token, mit dem man bedienen darf.",
  skip: "Zum Inhalt springen",
  pagesLabel: "Seiten",
  pages: {
    live: "Live",
    alignment: "Justage",
    design: "Auslegung",
    history: "Verlauf",
    settings: "Einstellungen",
    meter: "Fokus",
  },
};

export const stop: typeof en.stop = {
  stop: "STOP",
  more: (key) => `Hält sofort alle Achsen an (${key}, außer beim Schreiben von Text)`,
  key: (key) => `oder ${key}`,
  space: "Leertaste",
  stopped: "Angehalten",
  stoppedSince: (time, by) => `Angehalten um ${time}${by && ` (${by})`}`,
  unread: (why) =>
    `In welchem Zustand ein früherer Lauf den Halt hinterlassen hat, ist nicht bekannt: ${why}.`,
  notKept: "Er ist noch nicht gespeichert: Nach einem Neustart wäre der Prüfstand nicht angehalten.",
  stoppedMore: "Keine Achse fährt, bis der Halt aufgehoben ist.",
  sent: (focus, e) => `Fokusachse: ${focus}; e-Achse: ${e}.`,
  reset: "Halt aufheben",
  resetAsk: "Halt aufheben…",
  why: "Warum darf wieder gefahren werden?",
  whyMore: "was behoben ist; alle sehen es",
  stay: "Angehalten bleiben",
  wasReset: (by, time) => `Halt aufgehoben um ${time} (${by})`,
  hadStopped: (by, time) => `angehalten um ${time}${by && `, ${by}`}`,
  failed: "STOP NICHT ZUGESTELLT",
  failedMore: "Den Not-Halt am Prüfstand betätigen.",
  notStopped: "Der Prüfstand ist nicht angehalten",
  notStoppedMore: "Die Verbindung ist wieder da, Ihr STOP von vorhin aber nicht angekommen.",
  tried: "Die Seite versucht es weiter.",
  again: "Noch einmal anhalten",
  delivery: {
    confirmed: "angehalten",
    sent: "gesendet, nicht bestätigt",
    undeliverable: "NICHT ZUSTELLBAR",
  },
};

export const signIn: typeof en.signIn = {
  signIn: "Anmelden",
  more: "Dieser Dienst verlangt ein Token: Wer ihn verwaltet, erstellt eines mit „plenalign token create“. Was am Prüfstand läuft, läuft unterdessen weiter, und STOP ist von hier nicht zu erreichen: der Not-Halt am Prüfstand schon.",
  signOut: "Abmelden",
  token: "Token",
  handed:
    "Mit dem Link, den Sie geöffnet haben, können Sie die Schritte eines Auftrags bestätigen. Melden Sie sich an, dann stehen sie vor Ihnen.",
  ended: {
    revoked: (name, when, by) =>
      `Das Token von ${name} wurde ${by === null ? "am Rechner des Dienstes" : `von ${by}`} widerrufen, ${when}: Es lässt niemanden mehr ein.`,
    expired: (name, when) => `Das Token von ${name} ist abgelaufen, ${when}.`,
    demanded: "Von nun an wird von allen ein Token verlangt.",
  },
  scope: {
    view: "darf zusehen und anhalten",
    control: "darf bedienen",
    admin: "darf alles",
  },
};
