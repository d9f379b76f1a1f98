import { useEffect, useMemo, useState } from "preact/hooks";
import { isFocusLost } from "../../browser/focus";
import { fullScreen } from "../../picture/full-screen";
import { isFrozen } from "../../state";
import { Bench } from "../bench/control";
import { JobStrip } from "../job/strip";
import type { Given } from "../given";
import { CameraPanel } from "./camera-panel";
import { Charts } from "./charts";
import { Meter } from "./meter";
import { LivePicture } from "./picture";

/** Between two looks at the clock, ms. */
const CLOCK_MS = 500;

/** What an assembler works by. What a picture or a reading does not change is not drawn anew with each. */
export function LivePage(given: Given) {
  const { state, now } = given;
  const { picture, pictureAt, pictureOldMs, heardAt, ...more } = state;
  const { reading, readingAt, missing, missingAt, framesLeftOut, best, spacings, clarities, ...rest } = more;
  const [large, enlarge] = useLarge();
  const beat = Math.round(now / CLOCK_MS);
  const frozen = isFrozen(state, now);
  const about = [...Object.values(rest), beat, picture?.widthPx, frozen];
  const strip = useMemo(() => <JobStrip {...given} />, about);
  const meter = useMemo(() => <Meter {...given} />, about);
  const bench = useMemo(() => <Bench {...given} />, about);
  const camera = useMemo(() => <CameraPanel {...given} />, about);
  const charts = useMemo(() => <Charts {...given} />, [state.preferences.unit, beat]);
  if (large) return <LivePicture {...given} {...{ large, enlarge }} />;
  return (
    <div class="live-page">
      <div class="column">
        <LivePicture {...given} {...{ large, enlarge }} />
        {strip}
      </div>
      <div class="column">
        {meter}
        {bench}
        {camera}
      </div>
      {charts}
    </div>
  );
}

/** Whether the picture is alone on the page, on all of the screen where the browser has that. */
function useLarge(): [boolean, (large: boolean) => void] {
  const [large, set] = useState(false);
  const [held] = useState({ large });
  useEffect(() => {
    // The button is another one then.
    const lost = held.large !== large && isFocusLost();
    held.large = large;
    if (lost) document.getElementById("enlarge")?.focus({ preventScroll: true });
  }, [large]);
  useEffect(() => {
    // Escape gives the screen back.
    const changed = () => fullScreen.on || set(false);
    document.addEventListener("fullscreenchange", changed);
    return () => document.removeEventListener("fullscreenchange", changed);
  }, []);
  return [
    large,
    (wanted) => {
      set(wanted);
      void fullScreen.set(wanted);
    },
  ];
}
