import { useEffect, useState } from "preact/hooks";
import { same, type Json, type Key } from "../../design/config-schema";
import { numberOf } from "../../words/number";
import { strings } from "../../strings";
import type { ConfigFault } from "../../daemon/wire";
import { Choice } from "../toggle";

interface Props {
  of: Key;
  value: Json | undefined;
  changed: boolean;
  faults: ConfigFault[];
  editable: boolean;
  locked: boolean;
  set: (value: Json) => void;
}

/** One key: what it is called, what it means, what it is. */
export function ConfigField(props: Props) {
  const { of, value, changed, faults, locked } = props;
  const id = `key-${of.path}`;
  // What is no number is told in the page's words: the daemon's are a parser's.
  const noNumber = of.editor.by === "number" && typeof value === "string";
  const standard = of.standard === undefined ? "" : strings.settings.standard(shown(of.standard));
  return (
    <div class="config-key" data-changed={changed} data-wrong={faults.length > 0}>
      <label for={id}>
        <b>{of.name}</b>
        <small class="quiet">
          <span lang="en">{of.meaning}</span> {same(value, of.standard) ? "" : standard}
          {locked && ` (${strings.settings.locked})`}
        </small>
      </label>
      <Input {...props} id={id} />
      {noNumber && (
        <p class="fault" role="alert">
          {value.trim() === "" ? strings.form.needed : strings.form.noNumber}
        </p>
      )}
      {(noNumber ? [] : faults).map((fault) => (
        <p class="fault" role="alert" lang="en" key={fault.key + fault.message}>
          {fault.message}
        </p>
      ))}
    </div>
  );
}

function shown(value: Json): string {
  return typeof value === "string" ? value || "“”" : JSON.stringify(value);
}

function Input({ id, of, value, editable, set, faults }: Props & { id: string }) {
  const { editor } = of;
  if (editor.by === "switch") {
    const said = value === true ? strings.settings.yes : strings.settings.no;
    return (
      <Choice
        label={of.name}
        of={[strings.settings.yes, strings.settings.no]}
        chosen={said}
        disabled={!editable}
        choose={(word) => set(word === strings.settings.yes)}
      />
    );
  }
  if (editor.by === "choice") {
    return (
      <select
        id={id}
        value={typeof value === "string" ? value : ""}
        disabled={!editable}
        onChange={(event) => set(event.currentTarget.value)}
      >
        {editor.choices.map((choice) => (
          <option key={choice.value} value={choice.value} lang="en" title={choice.meaning}>
            {choice.value}
          </option>
        ))}
      </select>
    );
  }
  const wrong = faults.length > 0;
  return <TextInput id={id} editor={editor.by} value={value} editable={editable} wrong={wrong} set={set} />;
}

interface TextProps {
  id: string;
  editor: "number" | "text" | "json";
  value: Json | undefined;
  editable: boolean;
  wrong: boolean;
  set: (value: Json) => void;
}

function spelt(editor: TextProps["editor"], value: Json | undefined): string {
  if (value === undefined || value === null) return "";
  return editor === "json" ? JSON.stringify(value) : String(value);
}

/** What is typed, read as number, text or JSON; what cannot be read goes on as text, for the daemon to name it. */
function TextInput({ id, editor, value, editable, wrong, set }: TextProps) {
  const [text, setText] = useState(spelt(editor, value));
  const [broken, setBroken] = useState(false);
  const read = (typed: string): Json => {
    if (editor === "text") return typed;
    if (editor === "number") return Number.isFinite(numberOf(typed)) ? numberOf(typed) : typed;
    return JSON.parse(typed) as Json;
  };
  // Changed from outside: undone, or read anew.
  useEffect(() => {
    try {
      if (!same(read(text), value)) setText(spelt(editor, value));
    } catch {
      // Half typed.
    }
  }, [value]);
  const type = (typed: string) => {
    setText(typed);
    try {
      set(read(typed));
      setBroken(false);
    } catch {
      setBroken(true);
    }
  };
  return (
    <>
      <input
        id={id}
        value={text}
        disabled={!editable}
        inputMode={editor === "number" ? "decimal" : "text"}
        spellcheck={false}
        aria-invalid={wrong || broken}
        onInput={(event) => type(event.currentTarget.value)}
      />
      {broken && <p class="fault">{strings.settings.noJson}</p>}
    </>
  );
}
