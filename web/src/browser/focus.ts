// The focus, where what had it is no more: a browser leaves it at the page's beginning then.

/** Whether nobody is at anything: what had the focus is dead or gone. */
export function isFocusLost(): boolean {
  const at = document.activeElement;
  return at === null || at === document.body || at === content();
}

/** Has whoever is at the keyboard go on from the page's content where what they were at is taken away. */
export function watchFocus(): void {
  let last: Node | null = null;
  document.addEventListener("focusin", ({ target }) => (last = target instanceof Node ? target : null));
  // Who clicks beside everything is at nothing, and wants it so.
  document.addEventListener("pointerdown", () => (last = null));
  const watch = new MutationObserver(() => {
    if (last === null || last.isConnected || document.activeElement !== document.body) return;
    last = null;
    content()?.focus({ preventScroll: true });
  });
  watch.observe(document.body, { childList: true, subtree: true });
}

function content(): HTMLElement | null {
  return document.getElementById("content");
}
