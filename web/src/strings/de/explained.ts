// Was die Fachwörter bedeuten.

import type { explained as english } from "../en/explained";

const MEANINGS = {
  Δv: {
    term: "Änderung der Bildweite",
    meaning:
      "Bildweite weniger die der Auslegung in Luft; positiv: Mikrolinsenarray und Sensor weiter weg von der Hauptlinse",
  },
  e: {
    term: "e",
    meaning:
      "vom Mittelpunkt der Kugelschale zurück zum Hauptpunkt M der Hauptlinse; positiv: die Hauptlinse weiter weg vom Wasser",
  },
  EOG: {
    term: "Gradientenenergie",
    meaning:
      "Summe der quadrierten Unterschiede benachbarter Pixel der Zentralansicht: je größer, desto klarer das Bild",
  },
  MLA: {
    term: "Mikrolinsenarray",
    meaning: "die Platte kleiner Linsen vor dem Sensor, quadratisch oder hexagonal angeordnet",
  },
  l_bound: {
    term: "l_bound",
    meaning: "das kleinste e, das die Fassung der Hauptlinse zulässt, mit dem gewünschten Abstand",
  },
};

export const explained: typeof english = (word) => MEANINGS[word];
