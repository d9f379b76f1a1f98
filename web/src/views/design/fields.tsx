import { useEffect, useState } from "preact/hooks";
import { valueAt, withValue, type Json, type JsonObject } from "../../design/config-schema";
import { GROUPS, isChanged, spelt, typed, type DraftField, type Measure } from "../../design/draft";
import { fixed } from "../../words/format";
import { strings } from "../../strings";
import { reworded, type LengthUnit } from "../../words/units";
import { waterBy, waterSaid } from "../../design/water";
import type { ConfigFault } from "../../daemon/wire";
import { Choice } from "../toggle";

interface Props {
  base: JsonObject;
  edited: JsonObject;
  waterIndex: number;
  faults: ConfigFault[];
  unit: LengthUnit;
  set: (edited: JsonObject) => void;
}

/** Every value of the camera, to be edited. */
export function DraftFields(props: Props) {
  const { edited, waterIndex, set } = props;
  const by = waterBy(edited["water"]);
  const conditions: DraftField[] =
    by === "index"
      ? [{ path: "water.refractive_index", is: "number", measure: "plain" }]
      : [
          { path: "water.temperature_c", is: "number", measure: "celsius" },
          { path: "water.salinity_permille", is: "number", measure: "permille" },
          { path: "water.wavelength_nm", is: "number", measure: "nanometre" },
        ];
  return (
    <div class="draft-fields">
      {GROUPS.map((group) => (
        <fieldset key={group.name}>
          <legend>{strings.design.group[group.name]}</legend>
          {group.fields.map((field) => (
            <Field key={field.path} field={field} {...props} />
          ))}
        </fieldset>
      ))}
      <fieldset>
        <legend>{strings.design.waterTitle}</legend>
        <Choice
          label={strings.design.waterTitle}
          of={["index", "conditions"] as const}
          chosen={by}
          name={(one) => strings.design.water[one]}
          choose={(one) => one !== by && set({ ...edited, water: waterSaid(one, waterIndex) })}
        />
        {conditions.map((field) => (
          <Field key={field.path} field={field} {...props} />
        ))}
        {by === "conditions" && <p class="quiet">{strings.design.waterIndex(fixed(waterIndex, 5))}</p>}
      </fieldset>
    </div>
  );
}

function Field({ field, base, edited, faults, unit, set }: Props & { field: DraftField }) {
  const { path } = field;
  const value = valueAt(edited, path);
  const put = (value: Json) => set(withValue(edited, path, value));
  // What is no number is told in the page's words: the daemon's are a parser's.
  const noNumber = field.is === "number" && typeof value === "string";
  const wrong = noNumber ? [] : faults.filter((fault) => fault.key === path);
  const name = strings.design.field[path] ?? path;
  const id = `draft-${path}`;
  if (field.is === "choice") {
    return (
      <div class="draft-field choosing" data-changed={isChanged(base, edited, path)}>
        <span class="name">{name}</span>
        <Choice
          label={name}
          of={field.of}
          chosen={String(value)}
          name={(one) => strings.design.choices[one] ?? one}
          choose={put}
        />
      </div>
    );
  }
  return (
    <div class="draft-field" data-changed={isChanged(base, edited, path)}>
      <label for={id}>{name}</label>
      <NumberInput
        key={unit}
        id={id}
        value={value}
        measure={field.measure}
        unit={unit}
        wrong={noNumber || wrong.length > 0}
        set={put}
      />
      <span class="unit quiet" aria-hidden="true">
        {unitOf(field.measure, unit)}
      </span>
      {noNumber && (
        <p class="fault" role="alert" id={`${id}-fault`}>
          {String(value).trim() === "" ? strings.form.needed : strings.form.noNumber}
        </p>
      )}
      {wrong.map((fault) => (
        <p class="fault" role="alert" lang="en" id={`${id}-fault`} key={fault.message}>
          {reworded(fault.message, unit)}
        </p>
      ))}
    </div>
  );
}

function unitOf(measure: Measure, unit: LengthUnit): string {
  return strings.design.unit[measure] ?? unit;
}

interface NumberProps {
  id: string;
  value: Json | undefined;
  measure: Measure;
  unit: LengthUnit;
  wrong: boolean;
  set: (value: Json) => void;
}

function NumberInput({ id, value, measure, unit, wrong, set }: NumberProps) {
  const [text, setText] = useState(spelt(value, measure, unit));
  // Changed from outside: set back, or read anew.
  useEffect(() => {
    if (typed(text, measure, unit) !== value) setText(spelt(value, measure, unit));
  }, [value]);
  return (
    <input
      id={id}
      value={text}
      inputMode="decimal"
      spellcheck={false}
      autocomplete="off"
      aria-invalid={wrong}
      aria-describedby={wrong ? `${id}-fault` : undefined}
      onInput={(event) => {
        setText(event.currentTarget.value);
        set(typed(event.currentTarget.value, measure, unit));
      }}
    />
  );
}
