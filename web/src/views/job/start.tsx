import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { barred } from "../../job/barred";
import {
  check,
  draftOf,
  FIELDS,
  implied,
  KINDS,
  unless,
  type Draft,
  type Faults,
  type NumberField,
} from "../../job/kinds";
import { numberOf } from "../../words/number";
import { able, may } from "../../state";
import { another } from "../../words/names";
import { strings } from "../../strings";
import { length, pixels, typedMm, type LengthUnit } from "../../words/units";
import type { AxisName, Design, JobKind } from "../../daemon/wire";
import type { Given } from "../given";
import { useKept } from "../kept";
import { Explained } from "../term";
import { isPossible, PlanSummary, REST_MS, usePlan } from "./plan";
import { Choice, Toggle } from "../toggle";

const AXES = ["focus", "e"] as const;
/** Kinds that go where the joint solution says. */
const JOINT: JobKind[] = ["joint_alignment", "air_only", "shell_only"];

/** Kinds that go by a plan. */
const PLANNED: JobKind[] = [
  "joint_alignment",
  "air_only",
  "shell_only",
  "clarity_only",
  "l_bound_measurement",
];

/** Chooses a job, says what it will do, and starts it. */
export function StartJob(given: Given) {
  const { state, act } = given;
  const [drafted, setDraft] = useKept(given, "drafted");
  const draft = drafted ?? draftOf("joint_alignment");
  const { unit } = state.preferences;
  const [tried, setTried] = useState(false);
  const [starting, setStarting] = useState(false);
  // Through the shell the board stands where the shell step had it.
  const inWater = draft.kind === "focus_sweep" && state.bench?.shell === "on";
  const fields = FIELDS[draft.kind].filter(({ name }) => !(inWater && name === "distance_mm"));
  const checked = check(draft, fields, state.bench?.axes ?? [], unit);
  // What nobody has typed yet is not wrong before it is to be started.
  const isTyped = (name: string) => tried || draft.numbers[name as NumberField["name"]]?.trim();
  const faults: Faults = checked.ok
    ? {}
    : Object.fromEntries(Object.entries(checked.faults).filter(([name]) => isTyped(name)));
  const means = implied(draft, state.bench?.axes ?? [], unit);
  const eMm = eOf(draft, unit);
  // What is no number is not the default either.
  const isUnread = faults.e_mm !== undefined && eMm === null;
  const plan = usePlan(PLANNED.includes(draft.kind), eMm, state);
  const change = (part: Partial<Draft>) => setDraft({ ...draft, ...part });
  const other = api.lease.other(state.bench?.lease);
  const barring = state.bench ? barred(state.bench, draft) : [];
  const ready =
    Boolean(state.bench) &&
    !state.bench?.stop.latched &&
    !state.bench?.history_fault &&
    barring.length === 0 &&
    able(state, "control") &&
    other === null &&
    (plan === null || isPossible(plan, draft.kind));
  const submit = async (event: Event) => {
    event.preventDefault();
    setTried(true);
    if (!checked.ok || starting) return;
    setStarting(true);
    const started = await act(api.startJob(checked.request));
    setStarting(false);
    if (started) {
      setDraft({ ...draftOf(draft.kind), axis: draft.axis });
      setTried(false);
    }
  };
  return (
    <form class="card start" aria-label={strings.job.startTitle} onSubmit={(event) => void submit(event)}>
      <h2>{strings.job.startTitle}</h2>
      <label>
        <span>{strings.job.kindLabel}</span>
        <select
          id="kind"
          value={draft.kind}
          onChange={(event) =>
            setDraft(draftOf(event.currentTarget.value as JobKind, draft.note, draft.record))
          }
        >
          {KINDS.map((kind) => (
            <option key={kind} value={kind}>
              {strings.job.kinds[kind]}
            </option>
          ))}
        </select>
      </label>
      <p>
        <Explained text={strings.job.meaning[draft.kind]} />
      </p>
      <ol class="quiet">
        {strings.job.steps[draft.kind].map((step) => (
          <li key={step}>{step}</li>
        ))}
      </ol>
      {!isUnread && (
        <>
          <Aim kind={draft.kind} design={state.design} eMm={eMm} unit={unit} />
          {plan && <PlanSummary plan={plan} kind={draft.kind} unit={unit} />}
        </>
      )}
      {fields.map((field) => {
        if (field.is === "number") {
          return (
            <NumberInput
              key={field.name}
              field={field}
              text={draft.numbers[field.name] ?? ""}
              standard={unless(field.name, state.design, unit)}
              unit={unit}
              fault={faults[field.name]}
              set={(text) => change({ numbers: { ...draft.numbers, [field.name]: text } })}
            />
          );
        }
        return field.is === "axis" ? (
          <p class="row" key={field.name}>
            <span>{strings.job.axis}</span>
            <Choice
              label={strings.job.axis}
              of={AXES}
              chosen={draft.axis}
              name={(axis) => strings.axis.name[axis]}
              choose={(axis) => change({ axis })}
            />
          </p>
        ) : (
          <AxesInput
            key={field.name}
            chosen={draft.axes}
            fault={faults.axes}
            set={(axes) => change({ axes })}
          />
        );
      })}
      {means && <p class="aim">{means}</p>}
      <label>
        <span>{strings.job.note}</span>
        <input
          id="note"
          value={draft.note}
          maxLength={200}
          placeholder={strings.job.noteMore}
          onInput={(event) => change({ note: event.currentTarget.value })}
        />
      </label>
      <p class="row">
        <Toggle on={draft.record} set={(record) => change({ record })} title={strings.job.recordMore}>
          {strings.job.record}
        </Toggle>
      </p>
      <p class="actions">
        <button type="submit" id="start" class="primary" disabled={!ready}>
          {strings.job.start}: {strings.job.kinds[draft.kind]}
        </button>
      </p>
      {barring.map((why) => (
        <p class="quiet" key={why}>
          {why}
        </p>
      ))}
      {other !== null && may(state, "control") && (
        <p class="quiet">{strings.byHand.others(another(other, "first"))}</p>
      )}
      {!may(state, "control") && state.session !== null && <p class="quiet">{strings.viewOnly}</p>}
    </form>
  );
}

/** The e that a form asks to be held, mm; null where it asks for none, or none that could be. */
function eOf(draft: Draft, unit: LengthUnit): number | null {
  const e = numberOf(draft.numbers.e_mm ?? "");
  return draft.kind === "clarity_only" && Number.isFinite(e) ? typedMm(e, unit) : null;
}

interface AimProps {
  kind: JobKind;
  design: Design | null;
  /** Another e to hold than the design's. */
  eMm: number | null;
  unit: LengthUnit;
}

/** Where the design will have it go. */
function Aim({ kind, design, eMm, unit }: AimProps) {
  const held = useClarity(eMm);
  if (!design) return null;
  const { joint } = design;
  const clarity = eMm === null ? design.clarity : held;
  const text = JOINT.includes(kind)
    ? strings.job.aimOf(
        length(joint.delta_v_mm, unit, 4),
        length(joint.e_mm, unit, 3),
        pixels(design.spacing_target_px, 4),
      )
    : kind === "clarity_only" && clarity
      ? strings.job.aimClarity(length(clarity.delta_v_mm, unit, 4), length(clarity.e_mm, unit, 2))
      : null;
  return text === null ? null : (
    <p class="aim">
      {strings.job.aim} <b>{text}</b>
    </p>
  );
}

/** Δv in focus at another e than the design's: the daemon works it out; null until it has, and where it cannot. */
function useClarity(eMm: number | null): { delta_v_mm: number; e_mm: number } | null {
  const [found, setFound] = useState<{ delta_v_mm: number; e_mm: number } | null>(null);
  useEffect(() => {
    if (eMm === null) return undefined;
    let wanted = true;
    const timer = setTimeout(() => {
      void api.draftDesign("in_force", { assembly: { initial_e_mm: eMm } }).then((result) => {
        const clarity = result.ok && result.value.states.find(({ state }) => state === "clarity");
        if (wanted) setFound(clarity ? { delta_v_mm: clarity.delta_v_mm, e_mm: eMm } : null);
      });
    }, REST_MS);
    return () => {
      wanted = false;
      clearTimeout(timer);
    };
  }, [eMm]);
  return found?.e_mm === eMm ? found : null;
}

interface NumberProps {
  field: NumberField;
  text: string;
  standard: string;
  unit: LengthUnit;
  fault: string | undefined;
  set: (text: string) => void;
}

function NumberInput({ field, text, standard, unit, fault, set }: NumberProps) {
  return (
    <label>
      <span>
        {strings.job.fields[field.name]}{" "}
        <small class="quiet">{strings.job.fieldsMore[field.name](unit)}</small>
      </span>
      <input
        name={field.name}
        inputMode="decimal"
        value={text}
        aria-invalid={fault !== undefined}
        placeholder={standard === "" ? "" : strings.form.unless(standard)}
        onInput={(event) => set(event.currentTarget.value)}
      />
      {fault && (
        <span class="fault" role="alert">
          {fault}
        </span>
      )}
    </label>
  );
}

interface AxesProps {
  chosen: AxisName[];
  fault: string | undefined;
  set: (axes: AxisName[]) => void;
}

function AxesInput({ chosen, fault, set }: AxesProps) {
  return (
    <p class="row">
      <span>{strings.job.axes}</span>
      <span class="choice" role="group" aria-label={strings.job.axes}>
        {AXES.map((axis) => (
          <Toggle
            key={axis}
            on={chosen.includes(axis)}
            set={(on) => set(AXES.filter((one) => (one === axis ? on : chosen.includes(one))))}
          >
            {strings.axis.name[axis]}
          </Toggle>
        ))}
      </span>
      {fault && (
        <span class="fault" role="alert">
          {fault}
        </span>
      )}
    </p>
  );
}
