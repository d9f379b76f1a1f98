import * as api from "../../daemon/api";
import { span } from "../../words/format";
import { able, isFinal } from "../../state";
import { strings } from "../../strings";
import { reworded } from "../../words/units";
import type { Job, JobStep } from "../../daemon/wire";
import { Ask } from "../ask";
import { useAsked } from "../asked";
import type { Given } from "../given";
import { SetUpDrawing } from "./set-up";
import { mayConfirm } from "./turn";

/** The steps of a job: done, now, next; what was set up in each, how long it took, and the way to do one again. */
export function Steps(given: Given & { job: Job }) {
  const { job } = given;
  const steps = job.steps ?? [];
  if (steps.length === 0) return null;
  const over = isFinal(job.state);
  const list = (
    <ol class="steps">
      {steps.map((step, index) => (
        <Step key={index} {...given} step={step} over={over} />
      ))}
    </ol>
  );
  const done = steps.filter(({ began_at: began }) => Boolean(began)).length;
  return over ? (
    <details class="steps-taken">
      <summary>{strings.steps.summary(done)}</summary>
      {list}
    </details>
  ) : (
    <section class="steps-taken" aria-label={strings.steps.title}>
      <h3>{strings.steps.title}</h3>
      {list}
    </section>
  );
}

function Step(given: Given & { job: Job; step: JobStep; over: boolean }) {
  const { step, over } = given;
  const { unit } = given.state.preferences;
  const words = strings.steps;
  return (
    <li data-state={step.state} aria-current={step.state === "now" && !over ? "step" : undefined}>
      {step.setup && <SetUpDrawing setup={step.setup} unit={unit} small />}
      <div>
        <p class="what">
          <b>{words.name(step.name)}</b>
          {step.value ? ` ${reworded(step.value, unit)}` : ""}
        </p>
        <p class="facts">
          {typeof step.number === "number" && <span>{words.numbered(step.number)}</span>}
          <span class="state">{stateOf(step, over)}</span>
          {typeof step.repeats === "number" && <span>{words.repeats(step.repeats)}</span>}
          {took(step).map((text) => (
            <span key={text}>{text}</span>
          ))}
        </p>
        <Again {...given} />
      </div>
    </li>
  );
}

function stateOf({ state }: JobStep, over: boolean): string {
  return over && (state === "now" || state === "next")
    ? strings.steps.ended[state]
    : strings.steps.state[state];
}

/** How long the operator and the bench took; what took neither is not told. */
function took({ operator_s: operator, bench_s: bench }: JobStep): string[] {
  const told = (seconds: number | null | undefined, words: (text: string) => string) =>
    typeof seconds === "number" && seconds >= 0.05 ? [words(span(seconds * 1000))] : [];
  return [...told(operator, strings.steps.you), ...told(bench, strings.steps.bench)];
}

/** Asks for a step again that went wrong, where the job can go back to it. */
function Again(given: Given & { job: Job; step: JobStep }) {
  const { state, act, job, step } = given;
  const waiting = job.state === "waiting_for_operator" ? job.operator_step : null;
  const { number } = step;
  const offered =
    typeof number === "number" && (waiting?.repeatable ?? []).includes(number) && mayConfirm(state, job);
  const [asked, ask] = useAsked<true>(offered && able(state, "control"));
  if (!offered) return null;
  const words = strings.steps;
  if (!asked) {
    return (
      <button
        type="button"
        class="again"
        aria-label={words.againWhat(words.name(step.name))}
        disabled={!able(state, "control")}
        onClick={() => ask(true)}
      >
        {words.again}
      </button>
    );
  }
  const { white_frame: white, other } = words.againSure;
  return (
    <Ask
      question={step.name === "white_frame" ? white : other}
      yes={words.againYes}
      no={words.againNo}
      answer={(yes) => {
        ask(null);
        if (yes) void act(api.repeatStep(job, number));
      }}
    />
  );
}
