// The key that has a tone follow the spacing, or be silent.

import { focusedElement, isCombined, isTyping } from "../bench/stop-key";

export const TONE_KEY = { code: "KeyT", name: "T" };

/** Calls `toggle` when the key is pressed by itself, where it spells nothing. The stop key goes before it. */
export function watchToneKey(toggle: () => void): void {
  window.addEventListener("keydown", (event) => {
    if (event.code !== TONE_KEY.code || event.repeat || isCombined(event)) return;
    const focused = focusedElement();
    // In a list a letter goes to what begins with it.
    if (focused?.tagName === "SELECT" || isTyping(focused)) return;
    toggle();
  });
}
