import { moment } from "../../format";
import { useEffect, useState } from "preact/hooks";
import * as api from "../../api";
import { strings } from "../../strings";
import type { NewToken, Scope, Token } from "../../wire";
import { Ask } from "../ask";
import type { Scene } from "../scene";
import { Choice } from "../toggle";

const SCOPES: readonly Scope[] = ["view", "control", "admin"];

/** Who gets in. */
export function Tokens({ act, state }: Scene) {
  const [tokens, setTokens] = useState<Token[] | null>(null);
  const [made, setMade] = useState<NewToken | null>(null);
  const [asked, ask] = useState<Token | null>(null);
  const load = () =>
    act(
      api.tokens().then((result) => {
        if (result.ok) setTokens(result.value.tokens);
        return result;
      }),
    );
  useEffect(() => void load(), [state.bootId]);
  const revoke = async (token: Token) => {
    ask(null);
    if (await act(api.revokeToken(token))) await load();
  };
  return (
    <section class="card tokens" aria-label={strings.settings.tokens}>
      <h2>{strings.settings.tokens}</h2>
      <p class="quiet">{strings.settings.tokensMore}</p>
      {tokens?.length === 0 && (
        <p>
          {strings.settings.tokenNone} {strings.settings.tokenFirst}
        </p>
      )}
      <ul class="token-list">
        {tokens?.map((token) => (
          <li key={token.id}>
            <span>
              <b>{token.name}</b> · {strings.signIn.scope[token.scope]}
              <br />
              <span class="quiet">
                {strings.settings.tokenLast} {when(token.last_used_at, strings.settings.tokenUnused)} ·{" "}
                {strings.settings.tokenExpires} {when(token.expires_at, strings.settings.tokenNever)}
              </span>
            </span>
            <button
              type="button"
              aria-label={strings.settings.tokenRevokeMore(token.name)}
              onClick={() => ask(token)}
            >
              {strings.settings.tokenRevoke}
            </button>
          </li>
        ))}
      </ul>
      {asked && (
        <Ask
          question={strings.settings.tokenSure(asked.name)}
          yes={strings.settings.tokenYes}
          no={strings.settings.tokenNo}
          answer={(yes) => (yes ? void revoke(asked) : ask(null))}
        />
      )}
      {made && (
        <div class="secret" role="status">
          <p>{strings.settings.tokenSecret(made.name)}</p>
          <code>{made.secret}</code>
          <button type="button" onClick={() => setMade(null)}>
            {strings.close}
          </button>
        </div>
      )}
      <MakeToken
        make={async (name, scope) => {
          const ok = await act(
            api.makeToken({ name, scope }).then((result) => {
              if (result.ok) setMade(result.value);
              return result;
            }),
          );
          // With the first token this browser itself may have to sign in: then there is nothing to be listed.
          if (ok && tokens && tokens.length > 0) await load();
          return ok;
        }}
      />
    </section>
  );
}

function when(at: string | null | undefined, none: string): string {
  return at ? moment(at) : none;
}

function MakeToken({ make }: { make: (name: string, scope: Scope) => Promise<boolean> }) {
  const [name, setName] = useState("");
  const [scope, setScope] = useState<Scope>("view");
  return (
    <form
      class="make-token"
      onSubmit={(event) => {
        event.preventDefault();
        void make(name.trim(), scope).then((ok) => ok && setName(""));
      }}
    >
      <label>
        <span>{strings.settings.tokenName}</span>
        <input required maxLength={64} value={name} onInput={(event) => setName(event.currentTarget.value)} />
      </label>
      <Choice label={strings.settings.tokenScope} of={SCOPES} chosen={scope} choose={setScope} />
      <button type="submit">{strings.settings.tokenCreate}</button>
    </form>
  );
}
