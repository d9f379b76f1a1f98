import { useEffect, useRef, useState } from "preact/hooks";
import { age, fixed, span } from "../../words/format";
import { eyepiece, type Probe } from "../../picture/eyepiece";
import { ofSeveral } from "../../meter/reading";
import { knowsMotion } from "../../meter/set-up";
import { overlaysOn } from "../../picture/show";
import { isFrozen, pictureAge, pictureState } from "../../state";
import { strings } from "../../strings";
import type { Given } from "../given";
import { depthEnds } from "./depth-ends";
import { useGestures } from "./gestures";
import { Keeping } from "./keeping";
import { Measured, Measuring } from "./measuring";
import { Overlays } from "./overlays";

interface Props extends Given {
  /** Whether it is alone on the page. */
  large: boolean;
  enlarge: (large: boolean) => void;
}

export function LivePicture(given: Props) {
  const { state, now } = given;
  const { tool } = eyepiece.marking;
  const shown = pictureState(state, now);
  const ageMs = pictureAge(state, now);
  const facts = state.picture;
  const same = isFrozen(state, now);
  const camera = state.bench?.camera;
  return (
    <section
      class="card picture"
      data-state={shown}
      data-same={same}
      data-large={given.large}
      aria-label={strings.picture.live}
    >
      <div class="frame" style={{ aspectRatio: facts ? `${facts.widthPx} / ${facts.heightPx}` : "1" }}>
        <Canvases
          key={eyepiece.replaced}
          faded={state.missing !== null}
          label={
            tool
              ? strings.measuring.keys[tool]
              : strings.picture.keys(strings.picture.shown[state.preferences.show])
          }
        />
        <span class="stamps">
          {facts?.simulated && <span class="stamp">{strings.simulated}</span>}
          {facts?.replayed && <span class="stamp">{strings.replay}</span>}
        </span>
        {shown === "none" && <p class="over">{strings.picture.none}</p>}
        {same && facts && <p class="over">{strings.picture.same(facts.alike)}</p>}
        {shown === "stale" && ageMs !== null && <p class="over">{strings.picture.stale(span(ageMs))}</p>}
      </div>
      <Measured {...given} />
      <Overlays {...given} />
      <div class="tools">
        <Measuring {...given} />
        <Keeping {...given} />
      </div>
      <p class="facts">
        {facts && ageMs !== null && !same && (
          <span>
            {(facts.replayed ? strings.picture.played : strings.picture.frame)(facts.seq, age(ageMs))}
          </span>
        )}
        {shown === "fresh" && <span>{strings.picture.rate(fixed(eyepiece.rate, 1))}</span>}
        {facts && facts.framesSkipped > 0 && <span>{strings.picture.skipped(facts.framesSkipped)}</span>}
        {facts?.preview && <span class="tag">{strings.picture.preview}</span>}
        {facts && !facts.settled && !facts.replayed && (
          <span class="tag">
            {knowsMotion(state.bench) ? strings.picture.moving : strings.picture.mayMove}
          </span>
        )}
        {camera && !camera.online && (
          <span class="tag bad">
            {strings.picture.cameraOffline}
            {camera.fault ? <span lang="en">: {camera.fault}</span> : ""}
          </span>
        )}
        <Legend {...given} />
      </p>
      {camera?.notes.map((note) => (
        <p class="facts" role="note" lang="en" key={note}>
          {note}
        </p>
      ))}
    </section>
  );
}

/** `faded`: what is laid over the picture is of an earlier one, and cannot be made of this. */
function Canvases({ label, faded }: { label: string; faded: boolean }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  const over = useRef<HTMLCanvasElement>(null);
  const [probe, setProbe] = useState<Probe | null>(null);
  useEffect(() => {
    if (canvas.current && over.current) return eyepiece.attach(canvas.current, over.current);
    return undefined;
  }, []);
  const gestures = useGestures(setProbe);
  return (
    <>
      <canvas
        ref={canvas}
        id="live"
        tabIndex={0}
        role="img"
        aria-label={label}
        data-whole={eyepiece.whole}
        data-tool={eyepiece.marking.tool}
        {...gestures}
      />
      <canvas ref={over} class="overlay" data-faded={faded} aria-hidden="true" />
      {probe && (
        <span class="probe">
          {strings.picture.at(probe.x, probe.y, probe.grey === null ? "" : strings.picture.grey(probe.grey))}
        </span>
      )}
    </>
  );
}

/** What the overlays' colours mean. */
function Legend({ state }: Given) {
  const { show } = state.preferences;
  const overlays = overlaysOn(show, state.preferences.overlays);
  const map = eyepiece.newestMap;
  const behind = map && state.picture ? state.picture.seq - map.frameSeq : 0;
  const wanted = overlays.some((overlay) => overlay !== "saturation");
  const several = ofSeveral(state.reading);
  const { far, near } = depthEnds(state);
  return (
    <>
      {show === "depth" && (
        <span class="legend">
          <i class="far" /> {far} <i class="near" /> {near} · {strings.picture.legendUnknown}
        </span>
      )}
      {overlays.includes("error") && several && <span>{strings.meter.words[several.direction]}</span>}
      {overlays.includes("error") && map && !several && (
        <span class="legend">
          <i class="below" /> {strings.picture.legendBelow} <i class="above" /> {strings.picture.legendAbove}{" "}
          · {strings.picture.legendRange(fixed(map.rangePx, 2))} ·{" "}
          {map.stepPx === null
            ? strings.picture.legendLevel
            : strings.picture.legendLines(String(Number(map.stepPx.toPrecision(1))))}
        </span>
      )}
      {wanted && !map && <span>{strings.picture.mapNone}</span>}
      {wanted && map && behind > 0 && (
        <span class={state.missing ? "tag old" : undefined}>{strings.picture.mapOld(behind)}</span>
      )}
      {overlays.includes("saturation") && eyepiece.saturation !== null && (
        <span>{strings.picture.saturated(fixed(100 * eyepiece.saturation, 2))}</span>
      )}
    </>
  );
}
