import { useLayoutEffect, useRef } from "preact/hooks";
import { onceHeld, useSettled } from "./settled";

interface Props {
  question: string;
  /** The answer that does it; where it can be done in one of several ways, one for each. */
  yes: string | readonly string[];
  no: string;
  /** Called with whether, and in which of the ways. */
  answer: (yes: boolean, way: number) => void;
}

/**
 * Asks before something is done, in its place on the page: a modal dialogue would put STOP out of reach. The focus goes
 * to the answer that changes nothing, which Escape gives, too; none is taken in its first half second.
 */
export function Ask({ question, yes, no, answer }: Props) {
  const stay = useRef<HTMLButtonElement>(null);
  // Its words may go on changing: a position in them does.
  const settled = useSettled("asked");
  const box = useRef<HTMLDivElement>(null);
  // As it appears: a key pressed right after goes to where the focus is by then, which does not leave it any more.
  useLayoutEffect(() => {
    const from = document.activeElement;
    const asked = box.current;
    stay.current?.focus();
    // Back to what asked, unless the focus has gone elsewhere or that is no more.
    return () => {
      const within = asked?.contains(document.activeElement) ?? false;
      if (within && from instanceof HTMLElement && from.isConnected) from.focus({ preventScroll: true });
    };
  }, []);
  const say = (way: number | null) => settled && answer(way !== null, way ?? 0);
  return (
    <div
      ref={box}
      class="ask"
      role="alertdialog"
      aria-label={question}
      onKeyDown={({ key }) => key === "Escape" && say(null)}
    >
      <p>{question}</p>
      <p class="actions">
        {(typeof yes === "string" ? [yes] : yes).map((words, way) => (
          <button
            key={words}
            type="button"
            class="primary"
            aria-disabled={!settled}
            onKeyDown={onceHeld}
            onClick={() => say(way)}
          >
            {words}
          </button>
        ))}
        <button
          ref={stay}
          type="button"
          aria-disabled={!settled}
          onKeyDown={onceHeld}
          onClick={() => say(null)}
        >
          {no}
        </button>
      </p>
    </div>
  );
}
