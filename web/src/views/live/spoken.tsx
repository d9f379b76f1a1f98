import { useState } from "preact/hooks";
import type { Reading } from "../../meter/reading";
import { isNews, standing, type Said } from "../../meter/speech";

interface Props {
  /** Null where it is lost. */
  reading: Reading | null;
  /** What the meter says. */
  text: string;
  now: number;
}

/** What a screen reader says by itself, where it is news. Whoever goes to the meter with one is read the meter itself. */
export function Spoken({ reading, text, now }: Props) {
  const [last] = useState<{ said: Said | null }>({ said: null });
  if (isNews(last.said, reading, text, now)) {
    const { differencePx, direction } = reading ?? { differencePx: 0, direction: null };
    last.said = { text, differencePx, direction, at: now };
  }
  return (
    <p class="unseen" id="spoken" aria-live="polite">
      {standing(last.said, now)}
    </p>
  );
}
