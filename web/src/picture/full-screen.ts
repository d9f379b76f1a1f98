// The whole of the screen for the page, where the browser has that: on an iPhone it has it for films only.

export const fullScreen = {
  get possible(): boolean {
    return typeof document !== "undefined" && document.fullscreenEnabled === true;
  },
  get on(): boolean {
    return document.fullscreenElement !== null;
  },
  /** Whatever the browser refuses, the page goes on in its window. */
  async set(on: boolean): Promise<void> {
    try {
      if (on) await document.documentElement.requestFullscreen();
      else if (document.fullscreenElement) await document.exitFullscreen();
    } catch {
      // It says no where nobody has pressed anything.
    }
  },
};
