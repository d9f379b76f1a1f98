import { useEffect, useState } from "preact/hooks";
import { advice, type Moved } from "../../advice";
import { correction, tilt } from "../../correction";
import { fixed, signed, span } from "../../format";
import { digits } from "../../meter";
import { reading } from "../../reading";
import { currentJob, isFinal, measurementAge, OLD_MEASUREMENT_MS, type State } from "../../state";
import { strings } from "../../strings";
import type { Scene } from "../scene";
import { BestHeld } from "./best";
import { MeterScale } from "./meter-scale";
import { TiltArrow } from "./tilt-arrow";

const ARROW = { larger: "▲", smaller: "▼", there: "✓" } as const;
/** Between two things said to who listens, ms. */
const SPEAK_MS = 5000;

/** Whether Δv is being set, or e. */
function moved(state: State): Moved {
  const job = currentJob(state);
  if (job && !isFinal(job.state) && job.stage === "air") return "delta_v";
  return state.bench?.shell === "off" ? "delta_v" : "e";
}

/** The spacing against its target, to be read from two metres. */
export function Meter(scene: Scene) {
  const { state, now: clock } = scene;
  const now = reading(state.measurement);
  const age = measurementAge(state, clock);
  const old = age !== null && (age > OLD_MEASUREMENT_MS || state.link !== "open");
  const unit = state.preferences.unit;
  if (!now) {
    return (
      <section class="card meter" aria-label={strings.meter.title}>
        <h2>{strings.meter.title}</h2>
        <p>{strings.meter.none}</p>
        <p class="quiet">{strings.meter.noneMore}</p>
      </section>
    );
  }
  const places = digits(now.sigmaPx);
  const wanted = advice(now, correction(state.design, state.measurement), moved(state), unit);
  const leaning = tilt(state.design, state.measurement, state.picture?.widthPx ?? 0);
  const words = strings.meter.words[now.direction];
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
          <b id="spacing">{fixed(now.spacingPx, 4)}</b> ± {fixed(now.sigmaPx, 4)} · {strings.meter.target}{" "}
          {fixed(now.targetPx, 4)} px
        </span>
        {old && <span class="tag old">{strings.meter.ago(span(age))}</span>}
        {now.inFocus && <span class="tag good">✓ {strings.meter.inFocus}</span>}
      </h2>
      <p class="large" aria-hidden="true">
        <span class="arrow">
          {ARROW[now.direction]}
          <small>px</small>
        </span>
        <span class="number" id="difference">
          {difference}
        </span>
      </p>
      <MeterScale reading={now} best={state.best} blurPx={state.design?.blur_limit_px ?? null} />
      <p class="advice">
        <b>{words}.</b> {wanted.main}
        {wanted.other && (
          <small>
            , {wanted.other} ({strings.meter.estimate})
          </small>
        )}
      </p>
      <div class="meter-more">
        {leaning && <TiltArrow tilt={leaning} />}
        <BestHeld {...scene} />
      </div>
      {!old && <Spoken text={strings.meter.spoken(words, difference, wanted.main)} />}
    </section>
  );
}

/** Said aloud by a screen reader, no oftener than it can be listened to. */
function Spoken({ text }: { text: string }) {
  const [said, say] = useState(text);
  const [newest] = useState({ text });
  newest.text = text;
  useEffect(() => {
    const timer = setInterval(() => say(newest.text), SPEAK_MS);
    return () => clearInterval(timer);
  }, []);
  return (
    <p class="unseen" aria-live="polite">
      {said}
    </p>
  );
}
