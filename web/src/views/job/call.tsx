import { useEffect, useRef, useState } from "preact/hooks";
import { addressOf } from "../../browser/route";
import { jobUnderWay, turnOf, type State } from "../../state";
import { strings } from "../../strings";
import { mayConfirm } from "./turn";

/** That a step waits for the operator, and the way to it, where the page does not show it anyway. */
export function Call({ state }: { state: State }) {
  const job = jobUnderWay(state);
  const inSight = usePromptInSight();
  if (!job || turnOf(state) === null || inSight) return null;
  return (
    <a class="tag call" href={addressOf("alignment")} onClick={toThePrompt}>
      {mayConfirm(state, job) ? strings.job.turn : strings.job.operatorsTurn}
    </a>
  );
}

const prompt = () => document.querySelector<HTMLElement>(".turn.operator");

/** Whether the prompt is on the page, and not scrolled away. */
function usePromptInSight(): boolean {
  const [inSight, see] = useState(false);
  const watched = useRef<HTMLElement | null>(null);
  const watcher = useRef<IntersectionObserver | null>(null);
  // It comes and goes with the page and the job.
  useEffect(() => {
    const there = prompt();
    if (there === watched.current) return;
    watched.current = there;
    watcher.current?.disconnect();
    see(false);
    if (!there) return;
    watcher.current = new IntersectionObserver((seen) => see(seen.at(-1)?.isIntersecting ?? false));
    watcher.current.observe(there);
  });
  useEffect(() => () => watcher.current?.disconnect(), []);
  return inSight;
}

/** On a page that has the prompt somewhere it is brought into sight. */
function toThePrompt(event: MouseEvent): void {
  const there = prompt();
  if (!there) return;
  event.preventDefault();
  there.scrollIntoView({ block: "nearest" });
  (there.querySelector<HTMLElement>("#confirm") ?? there).focus({ preventScroll: true });
}
