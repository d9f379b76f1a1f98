import { useLayoutEffect, useRef, useState } from "preact/hooks";
import { moment } from "../words/format";
import type { State } from "../state";
import { strings } from "../strings";
import type { Problem, Session } from "../daemon/wire";
import { ProblemLine } from "./problem";

interface Props {
  /** Why one is out who was in. */
  out: State["out"];
  /** Whether one has come by a link with a job's confirm key. */
  handed: boolean;
  enter: (key: string) => Promise<Problem | null>;
}

/** Shown in the page's place to whom the daemon does not know. */
export function SignIn({ out, handed, enter }: Props) {
  const [key, setKey] = useState("");
  const [problem, setProblem] = useState<Problem | null>(null);
  const field = useRef<HTMLInputElement>(null);
  // There is nothing else to be at, and what one was at is gone.
  useLayoutEffect(() => field.current?.focus(), []);
  const submit = async (event: Event) => {
    event.preventDefault();
    setProblem(await enter(key.trim()));
    setKey("");
  };
  return (
    <form id="sign-in" class="card sign-in" onSubmit={(event) => void submit(event)}>
      <h2>{strings.signIn.signIn}</h2>
      {out && (
        <p id="out" role="status">
          <b>{whyOf(out)}</b>
        </p>
      )}
      {handed && <p id="handed">{strings.signIn.handed}</p>}
      <p>{strings.signIn.more}</p>
      <label>
        {strings.signIn.token}
        <input
          ref={field}
          type="password"
          autocomplete="current-password"
          required
          value={key}
          onInput={(event) => setKey(event.currentTarget.value)}
        />
      </label>
      <button type="submit">{strings.signIn.signIn}</button>
      {problem && <ProblemLine problem={problem} />}
    </form>
  );
}

function whyOf(out: NonNullable<State["out"]>): string {
  const words = strings.signIn.ended;
  if (out === "demanded") return words.demanded;
  const when = moment(out.at);
  return out.how === "revoked"
    ? words.revoked(out.name, when, out.by ?? null)
    : words.expired(out.name, when);
}

/** Who one is, and the way out. */
export function Who({ session, leave }: { session: Session; leave: () => void }) {
  return (
    <p class="who" data-signed-in={session.signed_in}>
      <span class="name" title={session.name}>
        {session.name}
      </span>
      <span class="scope">{strings.signIn.scope[session.scope]}</span>
      {session.signed_in && (
        <button id="sign-out" onClick={leave}>
          {strings.signIn.signOut}
        </button>
      )}
    </p>
  );
}
