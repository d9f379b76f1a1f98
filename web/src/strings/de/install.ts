// Wörter zum Installieren der Seite.

import type * as en from "../en/install";

export const install: typeof en.install = {
  title: "App",
  more: {
    installed: "Sie ist installiert. Ohne den Dienst zeigt sie nichts, und nichts davon behält sie.",
    offered: "Die Seite kann ein Symbol und ein eigenes Fenster haben. Ohne den Dienst zeigt sie nichts.",
    menu: "Das Menü des Browsers installiert sie („Installieren“, „Zum Startbildschirm“), wo er es kann. Ohne den Dienst zeigt sie nichts.",
    insecure: "Installieren lässt sie sich nur, wo die Seite über HTTPS kommt oder von diesem Rechner.",
  },
  install: "Installieren",
};
