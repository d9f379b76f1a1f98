// Words about installing the page.

import type { Installable } from "../../browser/install";

export const install = {
  title: "App",
  more: {
    installed: "It is installed. It shows nothing without the daemon, and keeps nothing of what it shows.",
    offered: "The page can have an icon and a window of its own. It shows nothing without the daemon.",
    menu: "The browser’s menu installs it (“Install”, “Add to Home screen”), where it can. It shows nothing without the daemon.",
    insecure: "It can be installed only where the page comes over HTTPS, or from this machine.",
  } satisfies Record<Installable, string>,
  install: "Install",
};
