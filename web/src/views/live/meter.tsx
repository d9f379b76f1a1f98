import { tilt } from "../../meter/correction";
import { fixed, span } from "../../words/format";
import { needle } from "../../meter/needle";
import { addressOf } from "../../browser/route";
import { isOfOne, ofSeveral } from "../../meter/reading";
import { isBeingSetUp, knowsMotion, showsTilt } from "../../meter/set-up";
import { jobUnderWay, may, type State } from "../../state";
import { strings } from "../../strings";
import { TONE_KEY } from "../../meter/tone-key";
import { nothingRead } from "../../meter/unread";
import type { Given } from "../given";
import { Explained } from "../term";
import { Toggle } from "../toggle";
import { BestHeld } from "./best";
import { MeterScale } from "./meter-scale";
import { ARROW, NO_FIGURE, readAloud, sentence, useNewest, useShown } from "./shown";
import { Spoken } from "./spoken";
import { TiltArrow, TiltUntold } from "./tilt-arrow";

/** The spacing against its target, to be read from two metres. */
export function Meter(earlier: Given) {
  const given = useNewest(earlier);
  const { state, now: clock } = given;
  const shown = useShown(given);
  if (isBeingSetUp(state.bench, jobUnderWay(state))) return <BeingSetUp />;
  const { reading: now, missing, why, old, ageMs: age, figure: large, words, wanted } = shown;
  const target = missing ?? state.reading;
  // What is of no one board is no figure to go by.
  const figure = now && isOfOne(now) ? now : null;
  if (!target) return <Nothing {...given} />;
  const several = ofSeveral(state.reading) !== null;
  const leaning = tilt(state.design, state.reading, state.widthPx);
  return (
    <section
      class="card meter"
      data-state={missing?.is ?? "measured"}
      data-old={old}
      data-direction={now?.direction}
      aria-label={strings.meter.title}
    >
      <h2>
        {strings.meter.title}
        <span class="quiet sigma">
          {figure && (
            <>
              <b id="spacing" data-captured-at={figure.capturedAt}>
                {fixed(figure.spacingPx, 4)}
              </b>{" "}
              {strings.meter.sigma(fixed(figure.sigmaPx, 4))} ·{" "}
            </>
          )}
          {now?.direction !== "unsaid" && strings.meter.target(fixed(target.targetPx, 4))}
        </span>
        <Alone />
      </h2>
      <p class="meter-tags">
        <Pace framesLeftOut={state.framesLeftOut} combined={now?.frames ?? 0} />
        {now && !now.settled && !old && (
          <span class="tag">{knowsMotion(state.bench) ? strings.meter.moving : strings.meter.mayMove}</span>
        )}
        {old && age !== null && <span class="tag old">{strings.meter.ago(span(age))}</span>}
        {shown.inFocus && <span class="tag good">{strings.meter.inFocus}</span>}
        <Toggle
          on={state.tone}
          set={(tone) => given.update({ tone })}
          title={strings.meter.toneMore(TONE_KEY.name)}
        >
          {strings.meter.tone}
        </Toggle>
      </p>
      <p class="large" role="img" aria-label={readAloud(large)}>
        <span class="arrow">
          {now ? ARROW[now.direction] : "?"}
          <small>{strings.meter.unit}</small>
        </span>
        <span class="number" id="difference">
          {large}
        </span>
      </p>
      <MeterScale
        reading={figure}
        best={state.best}
        blurPx={state.design?.blur_limit_px ?? null}
        tolerancePx={target.tolerancePx}
      />
      {why && (
        <p class="advice">
          <b>{why.what}:</b>{" "}
          <small lang={why.daemons ? "en" : undefined}>
            {why.text}
            {why.besides && "."}
          </small>
          {why.besides && (
            <>
              {" "}
              <small lang="en">{sentence(why.besides)}</small>
            </>
          )}
        </p>
      )}
      {!missing && now && words && wanted && (
        <p class="advice">
          <b>{sentence(words)}</b> <Explained text={wanted.main} />
          {wanted.other && (
            <small>
              <Explained text={strings.meter.otherwise(wanted.other)} />
            </small>
          )}
        </p>
      )}
      <div class="meter-more">
        {leaning &&
          (showsTilt(state.bench) && !several ? (
            <TiltArrow tilt={leaning} />
          ) : (
            <TiltUntold why={whyNoTilt(state)} />
          ))}
        <BestHeld {...given} />
      </div>
      {!old && (
        <Spoken
          reading={now}
          text={
            words && wanted
              ? strings.meter.spoken(words, readAloud(large), wanted.main)
              : strings.meter.missing.lost
          }
          now={clock}
        />
      )}
    </section>
  );
}

/** Why the spacing's change over the field is not called a tilt. */
function whyNoTilt({ bench, reading }: State): string {
  if (reading?.direction === "unsaid") return strings.meter.tiltUnsaid;
  if (reading?.direction === "unasked") return strings.meter.tiltUnknown;
  if (reading?.direction === "doubted") return strings.meter.tiltDoubted;
  const known = bench?.in_view !== "unknown" || ofSeveral(reading) !== null;
  return known ? strings.meter.tiltUntoldMore : strings.meter.tiltUnknown;
}

/** The way to the meter by itself. */
function Alone() {
  return (
    <a class="alone-link" href={addressOf("meter")} title={strings.meterPage.openMore}>
      {strings.meterPage.open}
    </a>
  );
}

/** While somebody sets up another scene, what is read is of none. */
function BeingSetUp() {
  return (
    <section class="card meter" data-state="being-set-up" aria-label={strings.meter.title}>
      <h2>{strings.meter.title}</h2>
      <p class="large">
        <span class="number">{NO_FIGURE}</span>
      </p>
      <p class="advice">
        <b>{strings.meter.beingSetUp}.</b> {strings.meter.beingSetUpMore}
      </p>
    </section>
  );
}

function Nothing({ state }: Given) {
  const { what, why, begins } = nothingRead(state);
  return (
    <section class="card meter" aria-label={strings.meter.title}>
      <h2>
        {strings.meter.title} <Alone />
      </h2>
      <p>{what}</p>
      {why !== null && (
        <p class="quiet">
          {why}{" "}
          {begins && state.route.page !== "alignment" && may(state, "control") && (
            <a href={addressOf("alignment")}>{strings.meter.noneBegin}</a>
          )}
        </p>
      )}
    </section>
  );
}

/** How many readings come a second, and of how many the figure is the mean; nothing where none come. */
function Pace({ framesLeftOut, combined }: { framesLeftOut: number; combined: number }) {
  const { rate } = needle;
  return (
    <span class="quiet pace" title={strings.meter.leftOut(framesLeftOut)}>
      {rate > 0 && strings.meter.rate(fixed(rate, 0))}
      {rate > 0 && combined > 1 && ` · ${strings.meter.mean(combined)}`}
    </span>
  );
}
