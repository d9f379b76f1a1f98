// Waiting for what is to come about: a state, never a time.

/** Looks again and again until there is something true, and returns that. What is thrown otherwise may have to be looked up. */
export async function until(holds, otherwise, allowedMs = 60_000) {
  const end = Date.now() + allowedMs;
  for (;;) {
    const found = await holds();
    if (found) return found;
    if (Date.now() > end) throw new Error(typeof otherwise === "string" ? otherwise : await otherwise());
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
}

/** Waits until what is under way in a page has been drawn, and its transitions are over. */
export async function drawn(page) {
  await page.evaluate(async () => {
    const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
    const ends = (animation) => Number.isFinite(animation.effect?.getComputedTiming().endTime);
    // What follows from another size is laid out in the first, and drawn in the second.
    for (let frames = 0; frames < 3; frames += 1) await frame();
    await Promise.allSettled(
      document
        .getAnimations()
        .filter(ends)
        .map((animation) => animation.finished),
    );
    await frame();
  });
}
