import { useLayoutEffect, useState } from "preact/hooks";
import { awake } from "../../browser/awake";
import { install } from "../../browser/install";
import { LANGUAGE_CHOICES, type LanguageChoice } from "../../words/language";
import { choosable, SPACE, type StopKey } from "../../bench/stop-key";
import { speak, strings } from "../../strings";
import { UNITS } from "../../words/units";
import type { Given } from "../given";
import { nameOfKey } from "../stop";
import { Choice, Toggle } from "../toggle";

/** What this browser remembers. */
export function Preferences({ state, newest, update }: Given) {
  const { preferences } = state;
  const set = (part: Partial<typeof preferences>) => update({ preferences: { ...preferences, ...part } });
  // Its words come first: until they are there the page goes on in the other language.
  const choose = async (language: LanguageChoice) => {
    try {
      await speak(language);
      update({ preferences: { ...newest().preferences, language } });
    } catch (error) {
      update({ problem: { type: "about:blank", title: strings.noAnswer, status: 0, detail: String(error) } });
    }
  };
  return (
    <section class="card preferences" aria-label={strings.settings.page}>
      <h2>{strings.settings.page}</h2>
      <p class="quiet">{strings.settings.pageMore}</p>
      <label>
        <span>
          {strings.settings.name} <small class="quiet">{strings.settings.nameMore}</small>
        </span>
        <input
          id="name"
          maxLength={64}
          value={preferences.name ?? ""}
          placeholder={strings.lease.owner}
          onInput={(event) => set({ name: event.currentTarget.value })}
        />
      </label>
      <p class="row">
        <span>
          {strings.settings.language} <small class="quiet">{strings.settings.languageMore}</small>
        </span>
        <Choice
          label={strings.settings.language}
          of={LANGUAGE_CHOICES}
          chosen={preferences.language}
          name={(choice) => strings.settings.languages[choice]}
          choose={(choice) => void choose(choice)}
        />
      </p>
      <p class="row">
        <span>{strings.settings.unit}</span>
        <Choice
          label={strings.settings.unit}
          of={UNITS}
          chosen={preferences.unit}
          choose={(unit) => set({ unit })}
        />
      </p>
      <p class="row">
        <span>
          {strings.settings.call} <small class="quiet">{strings.settings.callMore}</small>
        </span>
        <Toggle on={preferences.call} set={(call) => set({ call })}>
          {strings.settings.callOn}
        </Toggle>
      </p>
      <p class="row">
        <span>
          {strings.settings.awake}{" "}
          <small class="quiet">
            {awake.possible ? strings.settings.awakeMore : strings.settings.awakeNever}
          </small>
        </span>
        <Toggle
          on={preferences.awake && awake.possible}
          set={(wanted) => set({ awake: wanted })}
          disabled={!awake.possible}
        >
          {strings.settings.awakeOn}
        </Toggle>
      </p>
      <p class="row" id="install" data-state={install.state}>
        <span>
          {strings.install.title} <small class="quiet">{strings.install.more[install.state]}</small>
        </span>
        {install.state === "offered" && (
          <button type="button" onClick={() => void install.ask().then(() => set({}))}>
            {strings.install.install}
          </button>
        )}
      </p>
      <ChooseKey
        stopKey={preferences.stopKey}
        set={(stopKey) => set({ stopKey })}
        reset={() => set({ stopKey: SPACE })}
      />
    </section>
  );
}

interface KeyProps {
  stopKey: StopKey;
  set: (key: StopKey) => void;
  reset: () => void;
}

/** The key that stops. While another is chosen, the present one still stops. */
function ChooseKey({ stopKey, set, reset }: KeyProps) {
  const [listening, listen] = useState(false);
  // Before the prompt is painted: whoever reads it is heard.
  useLayoutEffect(() => {
    if (!listening) return undefined;
    const hear = (event: KeyboardEvent) => {
      event.preventDefault();
      event.stopPropagation();
      if (event.key === "Escape") return listen(false);
      const key = choosable(event);
      if (!key) return undefined;
      set(key);
      return listen(false);
    };
    window.addEventListener("keydown", hear, { capture: true });
    return () => window.removeEventListener("keydown", hear, { capture: true });
  }, [listening]);
  return (
    <div class="row stop-key">
      <span>
        {strings.settings.stopKey} <small class="quiet">{strings.settings.stopKeyMore}</small>
      </span>
      <span class="choice">
        <kbd id="stop-key">{nameOfKey(stopKey)}</kbd>
        <button type="button" onClick={() => listen(true)}>
          {listening ? strings.settings.stopKeyPress : strings.settings.stopKeyChange}
        </button>
        {stopKey.code !== SPACE.code && (
          <button type="button" onClick={reset}>
            {strings.settings.stopKeyReset}
          </button>
        )}
      </span>
    </div>
  );
}
