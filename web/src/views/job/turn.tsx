import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { absent } from "../../job/barred";
import { isDead, keyWithin } from "../../daemon/confirm-key";
import { able, may, type State } from "../../state";
import { called } from "../../words/names";
import { strings } from "../../strings";
import { reworded, type LengthUnit } from "../../words/units";
import type { Job, OperatorStep } from "../../daemon/wire";
import { Ask } from "../ask";
import { useAsked } from "../asked";
import type { Given } from "../given";
import { onceHeld, useSettled } from "../settled";
import { SetUpDrawing } from "./set-up";

/**
 * Whose turn it is: what waits for the operator, with the number that matters large, confirmed by whoever has a key of the
 * job; and the way out of it. Its buttons keep their place from prompt to prompt and between them, above all that varies.
 */
export function Turn(given: Given & { job: Job }) {
  const { state, act, job } = given;
  const { unit } = state.preferences;
  const step = job.state === "waiting_for_operator" ? job.operator_step : null;
  const setup = step && job.steps?.find(({ number }) => number === step.number)?.setup;
  const confirmable = Boolean(step) && mayConfirm(state, job);
  const heading = step ? headingOf(step, confirmable) : strings.job.itsTurn;
  const [sent, send] = useState<number | null>(null);
  const [leaving, leave] = useAsked<true>(job.state !== "cancelling" && able(state, "control"));
  const settled = useSettled(confirmable && step ? step.number : null);
  const { bench } = state;
  const kept = !bench?.history_fault;
  const missing = bench ? absent(bench, job.request) : [];
  const ready = settled && sent !== step?.number && able(state, "control") && kept && missing.length === 0;
  const box = useRef<HTMLDivElement>(null);
  const done = useRef<HTMLButtonElement>(null);
  useEffect(() => keepFocus(box.current, done.current), [step?.number, confirmable, leaving]);
  useDisproved(given, missing.join());
  const confirm = async () => {
    if (!ready || !step) return;
    send(step.number);
    // Where it could not be told, it may be pressed again.
    if (!(await act(api.confirmStep(job, step.number)))) send(null);
  };
  return (
    <div
      ref={box}
      class={step ? "turn operator" : "turn"}
      tabIndex={-1}
      role="group"
      aria-live="polite"
      aria-label={heading}
    >
      <h3>{heading}</h3>
      <p class="actions">
        {confirmable && (
          <button
            ref={done}
            type="button"
            id="confirm"
            class="primary"
            aria-disabled={!ready}
            onKeyDown={onceHeld}
            onClick={() => void confirm()}
          >
            {strings.job.confirm}
          </button>
        )}
        <button
          type="button"
          id="cancel"
          disabled={job.state === "cancelling" || !able(state, "control")}
          onClick={() => leave(true)}
        >
          {strings.job.cancel}
        </button>
      </p>
      {leaving && (
        <Ask
          question={strings.job.cancelSure}
          yes={strings.job.cancelYes}
          no={strings.job.cancelNo}
          answer={(yes) => {
            leave(null);
            if (yes) void act(api.cancelJob(job));
          }}
        />
      )}
      {confirmable && !kept && <p class="fault">{strings.job.notKept}</p>}
      {confirmable &&
        missing.map((what) => (
          <p class="fault" key={what}>
            {what}
          </p>
        ))}
      {step?.because && (
        <p class="notice wrong" role="alert">
          <b>{strings.job.onceMore}</b> <span lang="en">{reworded(step.because, unit)}</span>
        </p>
      )}
      {step?.value && <p class="number">{reworded(step.value, unit)}</p>}
      {step && <Instruction step={step} unit={unit} />}
      {step && setup && <SetUpDrawing setup={setup} unit={unit} />}
      {step && !confirmable && <GiveKey {...given} />}
    </div>
  );
}

/** What is to be done: in the page's language where it knows that, and in the daemon's words, which may say more. */
function Instruction({ step, unit }: { step: OperatorStep; unit: LengthUnit }) {
  const said = strings.prompt(step.name, reworded(step.value ?? "", unit));
  const { because } = step;
  const asked =
    because && step.instruction.startsWith(because)
      ? step.instruction.slice(because.length)
      : step.instruction;
  return (
    <>
      {said !== null && <p>{said}</p>}
      <p lang="en" class={said === null ? "" : "quiet"}>
        {reworded(asked, unit)}
      </p>
    </>
  );
}

/** Whose turn it is, to whoever may confirm it and to those who look on. */
function headingOf({ number }: OperatorStep, confirmable: boolean): string {
  return confirmable ? strings.job.operator(number) : strings.job.operators(number);
}

/** Enter answers a prompt, unless whoever is at the keyboard is at something else; what had the focus may be gone. */
function keepFocus(box: HTMLElement | null, done: HTMLElement | null): void {
  const focused = document.activeElement;
  const idle = focused === null || focused.contains(box);
  if (!idle) return;
  (done ?? box)?.focus({ preventScroll: true });
  // Nobody is to answer what is not in sight.
  done?.scrollIntoView({ block: "nearest" });
}

/** Whether this tab holds the lease that the job has, or the job's confirm key. */
export function mayConfirm(state: State, job: Job): boolean {
  if (!may(state, "control")) return false;
  const key = api.confirmKeys.of(job.id);
  if (key !== null && !isDead({ job: job.id, key }, state.bench)) return true;
  return api.lease.hasJob(state.bench?.lease ?? null, job.id);
}

/** Why nothing can be confirmed here, a place for the key, and another one for whoever may make it. */
function GiveKey({ state, act, update, job }: Given & { job: Job }) {
  const [text, setText] = useState("");
  const [wrong, setWrong] = useState(false);
  const [asking, here] = useAsked<true>(able(state, "admin"));
  if (!may(state, "control")) return <p class="quiet">{strings.viewOnly}</p>;
  const submit = (event: Event) => {
    event.preventDefault();
    const key = keyWithin(text);
    setWrong(key === null);
    if (key === null) return;
    api.confirmKeys.keep({ job: job.id, key });
    update({ problem: null });
  };
  const renew = async () => {
    here(null);
    if (await act(api.renewConfirmKey(job))) update({ problem: null });
  };
  return (
    <>
      {api.confirmKeys.of(job.id) !== null && <p class="fault">{strings.job.keyDead}</p>}
      <form class="give-key" onSubmit={submit}>
        <p>{strings.job.noKey(called(job.owner ?? ""))}</p>
        <label>
          {strings.job.confirmKey}{" "}
          <input
            id="confirm-key"
            type="password"
            autocomplete="off"
            required
            value={text}
            aria-invalid={wrong}
            onInput={(event) => setText(event.currentTarget.value)}
          />
        </label>
        <button type="submit">{strings.job.useKey}</button>
        {wrong && (
          <span class="fault" role="alert">
            {strings.job.noSuchKey}
          </span>
        )}
      </form>
      {able(state, "admin") && !asking && (
        <p>
          {strings.job.hereMore}{" "}
          <button type="button" id="confirm-here" onClick={() => here(true)}>
            {strings.job.here}
          </button>
        </p>
      )}
      {asking && (
        <Ask
          question={strings.job.hereSure}
          yes={strings.job.hereYes}
          no={strings.job.hereNo}
          answer={(yes) => (yes ? void renew() : here(null))}
        />
      )}
    </>
  );
}

/** An old picture is not why a prompt takes no answer any more, once something else is. */
function useDisproved({ state, update }: Given, others: string): void {
  useEffect(() => {
    if (state.problem?.type.endsWith("old-picture")) update({ problem: null });
  }, [others]);
}
