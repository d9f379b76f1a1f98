import { useLayoutEffect, useRef, useState } from "preact/hooks";
import { copy } from "../browser/clipboard";
import { strings } from "../strings";
import type { NewToken } from "../daemon/wire";

interface Props {
  made: NewToken;
  kept: () => void;
}

/** The secret of a token just made: on every page, until whoever made it says that it is kept. It is shown nowhere else. */
export function Secret({ made, kept }: Props) {
  const code = useRef<HTMLElement>(null);
  const copying = useRef<HTMLButtonElement>(null);
  const [copied, setCopied] = useState<boolean | null>(null);
  const words = strings.settings;
  // Whoever made it is at it, and then where they made it: the first one has the page drawn anew.
  useLayoutEffect(() => {
    const from = document.activeElement;
    copying.current?.focus({ preventScroll: true });
    return () => {
      if (from instanceof HTMLElement && from.isConnected) from.focus({ preventScroll: true });
    };
  }, []);
  return (
    <section class="secret" role="alert" id="secret" aria-label={words.tokenSecret(made.name)}>
      <p>
        <b>{words.tokenSecret(made.name)}</b> {words.tokenSecretMore}
      </p>
      <code ref={code}>{made.secret}</code>
      <p class="actions">
        <button
          type="button"
          ref={copying}
          class="primary"
          id="copy-secret"
          onClick={() => code.current && void copy(code.current).then(setCopied)}
        >
          {words.tokenCopy}
        </button>
        <button type="button" id="secret-kept" onClick={kept}>
          {words.tokenKept}
        </button>
        <span role="status">{copied !== null && (copied ? words.tokenCopied : words.tokenNotCopied)}</span>
      </p>
    </section>
  );
}
