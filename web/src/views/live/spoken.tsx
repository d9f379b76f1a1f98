import { useState } from "preact/hooks";
import type { Reading } from "../../reading";
import { isNews, type Said } from "../../speech";

/** What a screen reader says, where it is news. */
export function Spoken({ reading, text, now }: { reading: Reading | null; text: string; now: number }) {
  const [last] = useState<{ said: Said | null; text: string }>({ said: null, text: "" });
  if (isNews(last.said, reading, now)) {
    last.said = { differencePx: reading?.differencePx ?? 0, direction: reading?.direction ?? null, at: now };
    last.text = text;
  }
  return (
    <p class="unseen" id="spoken" aria-live="polite">
      {last.text}
    </p>
  );
}
