import { useEffect, useRef } from "preact/hooks";

interface Props {
  question: string;
  yes: string;
  no: string;
  answer: (yes: boolean) => void;
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
        <button type="button" class="primary" onClick={() => answer(true)}>
          {yes}
        </button>
        <button ref={stay} type="button" onClick={() => answer(false)}>
          {no}
        </button>
      </p>
    </div>
  );
}
