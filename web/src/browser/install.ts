// Installing the page as an app of its own, as browsers offer it to pages of HTTPS and of this machine. Nothing works without the
// daemon, so that there is no service worker: none is needed to install it, and one could show an old page as live.

/** What Chromium has a page ask with. */
interface Prompt extends Event {
  prompt(): Promise<unknown>;
}

export type Installable =
  /** It is. */
  | "installed"
  /** The browser can be asked to. */
  | "offered"
  /** By the browser's menu, where it has that. */
  | "menu"
  /** Not over plain HTTP. */
  | "insecure";

export class Install {
  private prompt: Prompt | null = null;

  /** Hears the browser's offer from now on; `changed` is told of it, and of its end. */
  watch(changed: () => void): void {
    window.addEventListener("beforeinstallprompt", (event) => {
      // Asked for in Settings, not in the midst of something.
      event.preventDefault();
      this.prompt = event as Prompt;
      changed();
    });
    window.addEventListener("appinstalled", () => {
      this.prompt = null;
      changed();
    });
  }

  get state(): Installable {
    if (matchMedia("(display-mode: standalone)").matches) return "installed";
    if (!window.isSecureContext) return "insecure";
    return this.prompt ? "offered" : "menu";
  }

  /** Has the browser ask whether to install it; an offer holds for one question. */
  async ask(): Promise<void> {
    const { prompt } = this;
    this.prompt = null;
    await prompt?.prompt();
  }
}

/** The page's one. */
export const install = new Install();
