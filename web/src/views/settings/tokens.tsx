import { aboutWhen, moment } from "../../words/format";
import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { aheadOfWall, secondsLeft } from "../../daemon/clock";
import { strings } from "../../strings";
import { able, type State } from "../../state";
import type { Scope, Token, TokenRequest } from "../../daemon/wire";
import { Ask } from "../ask";
import { useAsked } from "../asked";
import type { Given } from "../given";
import { Choice } from "../toggle";

const SCOPES: readonly Scope[] = ["view", "control", "admin"];

/** How long a token can be made to last, h; infinity for until it is revoked. */
const LASTS = { forever: Infinity, shift: 8, week: 7 * 24, quarter: 90 * 24 } as const;
type Lasting = keyof typeof LASTS;
const HOUR_MS = 3_600_000;

/** How often the list is asked for anew, ms. */
const RENEWED_MS = 5_000;

/** Who gets in. */
export function Tokens({ act, load, state, now, makeToken }: Given) {
  const [tokens, setTokens] = useState<Token[] | null>(null);
  const here = able(state, "admin");
  const [wanted, want] = useAsked<TokenRequest>(here);
  const [asked, ask] = useAsked<Token>(here);
  const linked = state.link === "open";
  const look = () =>
    load(
      api.tokens().then((result) => {
        if (result.ok) setTokens(result.value.tokens);
        return result;
      }),
    );
  useEffect(() => {
    if (!linked) return;
    void look();
    // Others make tokens, too, and when one was used last goes on.
    const again = setInterval(() => void look(), RENEWED_MS);
    return () => clearInterval(again);
  }, [state.bootId, linked]);
  const first = isFirst(state);
  const lets = (token: Token) => letsIn(token, state, now);
  const make = async (token: TokenRequest) => {
    want(null);
    const made = await makeToken(token);
    if (made) await look();
    return made;
  };
  const revoke = async (token: Token) => {
    ask(null);
    if (await act(api.revokeToken(token))) await look();
  };
  return (
    <section class="card tokens" aria-label={strings.settings.tokens}>
      <h2>{strings.settings.tokens}</h2>
      <p class="quiet">{strings.settings.tokensMore}</p>
      {first && <p>{strings.settings.tokenNone}</p>}
      <ul class="token-list">
        {tokens?.map((token) => (
          <li key={token.id}>
            <span>
              <b>{token.name}</b> · {strings.signIn.scope[token.scope]}
              <br />
              <span class="quiet">
                {strings.settings.tokenLast}{" "}
                {token.last_used_at ? aboutWhen(token.last_used_at) : strings.settings.tokenUnused} ·{" "}
                {lets(token) ? strings.settings.tokenExpires : strings.settings.tokenExpired}{" "}
                {when(token.expires_at, strings.settings.tokenNever)}
              </span>
            </span>
            <button
              type="button"
              aria-label={strings.settings.tokenRevokeMore(token.name)}
              disabled={!here}
              onClick={() => ask(token)}
            >
              {strings.settings.tokenRevoke}
            </button>
          </li>
        ))}
      </ul>
      {asked && (
        <Ask
          key={asked.id}
          question={[
            strings.settings.tokenSure(asked.name),
            ...losses(asked, (tokens ?? []).filter(lets), state),
          ].join(" ")}
          yes={strings.settings.tokenYes}
          no={strings.settings.tokenNo}
          answer={(yes) => (yes ? void revoke(asked) : ask(null))}
        />
      )}
      {wanted && (
        <Ask
          key={`${wanted.name} ${wanted.scope}`}
          question={[
            strings.settings.tokenFirst,
            wanted.scope === "admin" ? strings.settings.tokenFirstMore : strings.settings.tokenFirstLess,
          ].join(" ")}
          yes={strings.settings.tokenFirstYes}
          no={strings.settings.tokenFirstNo}
          answer={(yes) => (yes ? void make(wanted) : want(null))}
        />
      )}
      <MakeToken
        key={String(first)}
        first={first}
        disabled={!here}
        make={async (token, lasting) => {
          if (!first) return make({ ...token, expires_at: inHours(LASTS[lasting], state, now) });
          want(token);
          return false;
        }}
      />
    </section>
  );
}

function when(at: string | null | undefined, none: string): string {
  return at ? moment(at) : none;
}

/** Whether nobody has had to sign in so far: with the first token everybody has to. */
function isFirst({ session }: State): boolean {
  return session !== null && session !== "stranger" && !session.demanded;
}

/** Whether a token still lets somebody in, by the daemon's clock: the browser's may be wrong. */
function letsIn({ expires_at: until }: Token, { clock }: State, now: number): boolean {
  return !until || secondsLeft(until, clock, now) > 0;
}

/** The moment in so many hours by the daemon's clock, RFC 3339: the browser's may be wrong; null for never. */
function inHours(hours: number, { clock }: State, now: number): string | null {
  if (!Number.isFinite(hours)) return null;
  const aheadMs = aheadOfWall(clock);
  const today = aheadMs === null ? Date.now() : now - aheadMs;
  return new Date(today + hours * HOUR_MS).toISOString();
}

/** Who loses more by its end than a token, of those that are valid. */
function losses(token: Token, valid: Token[], { session }: State): string[] {
  const words = strings.settings;
  const mine = session !== null && session !== "stranger" && session.signed_in && session.name === token.name;
  if (!valid.some(({ id }) => id === token.id)) return [];
  const admins = valid.filter(({ scope }) => scope === "admin");
  return [
    ...(mine ? [words.tokenMine] : []),
    ...(valid.length === 1
      ? [words.tokenLastOne]
      : token.scope === "admin" && admins.length === 1
        ? [words.tokenLastAdmin]
        : []),
  ];
}

interface MakeProps {
  /** Whether there is none yet: the first is for an administrator and does not end by itself. */
  first: boolean;
  disabled: boolean;
  /** Whether there is nothing more to be said of it. */
  make: (token: TokenRequest, lasting: Lasting) => Promise<boolean>;
}

function MakeToken({ first, disabled, make }: MakeProps) {
  const [name, setName] = useState("");
  const [scope, setScope] = useState<Scope>(first ? "admin" : "view");
  const [lasting, setLasting] = useState<Lasting>("forever");
  return (
    <form
      class="make-token"
      onSubmit={(event) => {
        event.preventDefault();
        void make({ name: name.trim(), scope }, lasting).then((ok) => ok && setName(""));
      }}
    >
      <label>
        <span>{strings.settings.tokenName}</span>
        <input
          id="token-name"
          required
          maxLength={64}
          value={name}
          onInput={(event) => setName(event.currentTarget.value)}
        />
      </label>
      <Choice
        label={strings.settings.tokenScope}
        of={SCOPES}
        chosen={scope}
        name={(scope) => strings.signIn.scope[scope]}
        choose={setScope}
      />
      {!first && (
        <Choice
          label={strings.settings.tokenLasts}
          of={Object.keys(LASTS) as Lasting[]}
          chosen={lasting}
          name={(lasting) => strings.settings.tokenLasting[lasting]}
          choose={setLasting}
        />
      )}
      <button type="submit" disabled={disabled}>
        {strings.settings.tokenCreate}
      </button>
    </form>
  );
}
