// The screen's next frame, in a worker and in a window alike.

/** A canvas out of sight may have no frames, ms. */
const LONGEST_MS = 100;

/** Calls back at the screen's next frame, or soon in any case. */
export function onFrame(act: () => void): void {
  let frame = 0;
  const timer = setTimeout(() => {
    cancelAnimationFrame(frame);
    act();
  }, LONGEST_MS);
  frame = requestAnimationFrame(() => {
    clearTimeout(timer);
    act();
  });
}
