import { useState } from "preact/hooks";
import { able } from "../state";
import { strings } from "../strings";
import type { Given } from "./given";

/** Asks, once in a browser, what others are to be told who has control here. */
export function AskName({ state, update }: Given) {
  const [text, setText] = useState("");
  const { preferences } = state;
  const known = state.session !== null && state.session !== "stranger" && state.session.signed_in;
  if (preferences.name !== null || known || !able(state, "control")) return null;
  const name = (name: string) => {
    update({ preferences: { ...preferences, name } });
    // What had the focus goes.
    document.getElementById("content")?.focus({ preventScroll: true });
  };
  return (
    <form
      class="ask-name"
      aria-label={strings.lease.askName}
      onSubmit={(event) => {
        event.preventDefault();
        name(text.trim());
      }}
    >
      <label for="your-name">
        <b>{strings.lease.askName}</b> {strings.lease.askNameMore}
      </label>
      <input
        id="your-name"
        maxLength={64}
        autocomplete="name"
        value={text}
        onInput={(event) => setText(event.currentTarget.value)}
      />
      <button type="submit" disabled={text.trim() === ""}>
        {strings.lease.askNameKeep}
      </button>
      <button type="button" id="no-name" onClick={() => name("")}>
        {strings.lease.askNameNot}
      </button>
    </form>
  );
}
