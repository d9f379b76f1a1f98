import { useEffect, useRef } from "preact/hooks";

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
 * to the answer that changes nothing.
 */
export function Ask({ question, yes, no, answer }: Props) {
  const stay = useRef<HTMLButtonElement>(null);
  useEffect(() => stay.current?.focus(), []);
  return (
    <div class="ask" role="alertdialog" aria-label={question}>
      <p>{question}</p>
      <p class="actions">
        {(typeof yes === "string" ? [yes] : yes).map((words, way) => (
          <button key={words} type="button" class="primary" onClick={() => answer(true, way)}>
            {words}
          </button>
        ))}
        <button ref={stay} type="button" onClick={() => answer(false, 0)}>
          {no}
        </button>
      </p>
    </div>
  );
}
