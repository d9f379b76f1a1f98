import { useState } from "preact/hooks";
import { advice, type Moved } from "../../advice";
import { correction, tilt } from "../../correction";
import { fixed, signed, span } from "../../format";
import { steadyDigits } from "../../meter";
import { reading, type Reading } from "../../reading";
import { isNews, type Said } from "../../speech";
import { addressOf } from "../../route";
import { currentJob, isFinal, may, measurementAge, OLD_MEASUREMENT_MS, type State } from "../../state";
import { strings } from "../../strings";
import type { Scene } from "../scene";
import { BestHeld } from "./best";
import { MeterScale } from "./meter-scale";
import { TiltArrow } from "./tilt-arrow";

const ARROW = { larger: "▲", smaller: "▼", there: "✓" } as const;

/** Whether Δv is being set, or e. */
function moved(state: State): Moved {
  const job = currentJob(state);
  if (job && !isFinal(job.state) && job.stage === "air") return "delta_v";
  return state.bench?.shell === "off" ? "delta_v" : "e";
}

/** The spacing against its target, to be read from two metres. */
export function Meter(scene: Scene) {
  const { state, now: clock } = scene;
  const [held] = useState<{ places: number | null }>({ places: null });
  const now = reading(state.measurement);
  const age = measurementAge(state, clock);
  const old = age !== null && (age > OLD_MEASUREMENT_MS || state.link !== "open");
  const unit = state.preferences.unit;
  if (!now) {
    return (
      <section class="card meter" aria-label={strings.meter.title}>
        <h2>{strings.meter.title}</h2>
        <p>{strings.meter.none}</p>
        <p class="quiet">
          {strings.meter.noneMore}{" "}
          {state.route.page !== "alignment" && may(state, "control") && (
            <a href={addressOf("alignment")}>{strings.meter.noneBegin}</a>
          )}
        </p>
      </section>
    );
  }
  held.places = steadyDigits(now.sigmaPx, held.places);
  const { places } = held;
  const wanted = advice(now, correction(state.design, state.measurement), moved(state), unit);
  const leaning = tilt(state.design, state.measurement, state.picture?.widthPx ?? 0);
  const words = (now.inFocus ? strings.meter.sharp : strings.meter.words)[now.direction];
  const difference = signed(now.differencePx, places);
  return (
    <section
      class="card meter"
      data-old={old}
      data-direction={now.direction}
      aria-label={strings.meter.title}
    >
      <h2>
        {strings.meter.title}
        <span class="quiet sigma">
          <b id="spacing">{fixed(now.spacingPx, 4)}</b>{" "}
          {strings.meter.against(fixed(now.sigmaPx, 4), fixed(now.targetPx, 4))}
        </span>
        {old && <span class="tag old">{strings.meter.ago(span(age))}</span>}
        {now.inFocus && !old && <span class="tag good">✓ {strings.meter.inFocus}</span>}
      </h2>
      <p class="large" aria-hidden="true">
        <span class="arrow">
          {ARROW[now.direction]}
          <small>{strings.meter.unit}</small>
        </span>
        <span class="number" id="difference">
          {difference}
        </span>
      </p>
      <MeterScale reading={now} best={state.best} blurPx={state.design?.blur_limit_px ?? null} />
      <p class="advice">
        <b>{words}.</b> {wanted.main}
        {wanted.other && <small>{strings.meter.otherwise(wanted.other)}</small>}
      </p>
      <div class="meter-more">
        {leaning && <TiltArrow tilt={leaning} />}
        <BestHeld {...scene} />
      </div>
      {!old && (
        <Spoken reading={now} text={strings.meter.spoken(words, difference, wanted.main)} now={clock} />
      )}
    </section>
  );
}

/** What a screen reader says, where it is news. */
function Spoken({ reading, text, now }: { reading: Reading; text: string; now: number }) {
  const [last] = useState<{ said: Said | null; text: string }>({ said: null, text: "" });
  if (isNews(last.said, reading, now)) {
    last.said = { differencePx: reading.differencePx, direction: reading.direction, at: now };
    last.text = text;
  }
  return (
    <p class="unseen" id="spoken" aria-live="polite">
      {last.text}
    </p>
  );
}
