import { fixed, span } from "../../words/format";
import { isOfOne } from "../../meter/reading";
import { isBeingSetUp, knowsMotion } from "../../meter/set-up";
import { jobUnderWay } from "../../state";
import { strings } from "../../strings";
import { TONE_KEY } from "../../meter/tone-key";
import { nothingRead } from "../../meter/unread";
import { FullScreen } from "../full-screen";
import { Call } from "../job/call";
import { ARROW, NO_FIGURE, readAloud, sentence, useNewest, useShown } from "../live/shown";
import { Spoken } from "../live/spoken";
import type { Given } from "../given";
import { Toggle } from "../toggle";

/** A figure is not to jump in size with its last digit. */
const LEAST_LETTERS = 7;

/** The meter by itself, to be read from three metres on a phone, and across a room on a screen. */
export function MeterPage(earlier: Given) {
  const given = useNewest(earlier);
  const { state, now, update } = given;
  const shown = useShown(given);
  const job = jobUnderWay(state);
  const settingUp = isBeingSetUp(state.bench, job);
  const { missing, why, old, ageMs, words, wanted, inFocus } = shown;
  const reading = settingUp ? null : shown.reading;
  const figure = settingUp ? NO_FIGURE : shown.figure;
  const nothing = nothingRead(state);
  const says = settingUp
    ? { of: strings.meter.beingSetUp, more: strings.meter.beingSetUpMore }
    : why
      ? { of: `${why.what}:`, more: why.text }
      : reading
        ? { of: words ?? "", more: wanted?.main ?? "" }
        : { of: nothing.what, more: nothing.why ?? "" };
  return (
    <section
      class="meter-alone"
      data-state={settingUp ? "being-set-up" : (missing?.is ?? (reading ? "measured" : "none"))}
      data-old={old}
      data-direction={reading?.direction}
      aria-label={strings.meter.title}
    >
      <p
        class="huge"
        role="img"
        aria-label={readAloud(figure)}
        style={{ "--letters": Math.max(LEAST_LETTERS, figure.length) }}
      >
        <span class="glyph">{reading ? ARROW[reading.direction] : "?"}</span>
        <span class="number" id="difference">
          {figure}
        </span>
        {reading && <span class="unit">{strings.meterPage.unit}</span>}
      </p>
      <p class="meter-tags">
        {old && ageMs !== null ? (
          <span class="tag old">{strings.meter.ago(span(ageMs))}</span>
        ) : (
          reading && (
            <span class="age">
              {ageMs === null ? "" : strings.meterPage.age(fixed(Math.max(0, ageMs) / 1000, 1))}
            </span>
          )
        )}
        {inFocus && !settingUp && <span class="tag good">{strings.meter.inFocus}</span>}
        {reading && !reading.settled && !old && (
          <span class="tag">{knowsMotion(state.bench) ? strings.meter.moving : strings.meter.mayMove}</span>
        )}
        <Call state={state} />
      </p>
      <p class="advice">
        <b>{sentence(says.of)}</b>{" "}
        <span lang={why?.daemons && !settingUp ? "en" : undefined}>{says.more}</span>{" "}
        {!settingUp && why?.besides && <span lang="en">({why.besides})</span>}
      </p>
      <p class="quiet exact">
        {reading &&
          isOfOne(reading) &&
          strings.meterPage.spacing(
            fixed(reading.spacingPx, 4),
            fixed(reading.sigmaPx, 4),
            fixed(reading.targetPx, 4),
          )}
      </p>
      <p class="actions">
        <Toggle
          on={state.tone}
          set={(tone) => update({ tone })}
          title={strings.meter.toneMore(TONE_KEY.name)}
        >
          {strings.meter.tone} <kbd>{TONE_KEY.name}</kbd>
        </Toggle>
        <FullScreen />
      </p>
      {!old && !settingUp && (reading || missing?.is === "lost") && (
        <Spoken
          reading={reading}
          text={reading ? strings.meter.spoken(says.of, readAloud(figure), says.more) : says.of}
          now={now}
        />
      )}
    </section>
  );
}
