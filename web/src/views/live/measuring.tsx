import { eyepiece } from "../../picture/eyepiece";
import { fixed, signed } from "../../words/format";
import { lengthOf, type Region, type Ruler, type Tool } from "../../picture/marks";
import { digits } from "../../meter/scale";
import { ofSeveral } from "../../meter/reading";
import { isOfAnotherPlace } from "../../picture/region";
import { isFrozen, isMeterOld, pictureState } from "../../state";
import { strings } from "../../strings";
import type { Given } from "../given";
import { Toggle } from "../toggle";

const TOOLS: Tool[] = ["region", "ruler"];

/** What can be measured in the raw frame. */
export function Measuring({ state }: Given) {
  const raw = state.preferences.show === "raw";
  const { marking } = eyepiece;
  const words = strings.measuring;
  return (
    <span class="choice" role="group" aria-label={words.title}>
      <Toggle
        on={raw && marking.marks.crosshair}
        set={(on) => marking.showCrosshair(on)}
        title={words.crosshairMore}
        disabled={!raw}
      >
        {words.crosshair}
      </Toggle>
      {TOOLS.map((tool) => (
        <Toggle
          key={tool}
          on={raw && marking.tool === tool}
          set={(on) => marking.use(on ? tool : null)}
          title={words.toolMore[tool]}
          disabled={!raw}
        >
          {words.tool[tool]}
        </Toggle>
      ))}
    </span>
  );
}

/** What has been measured, in words. */
export function Measured({ state, now }: Given) {
  if (state.preferences.show !== "raw") return null;
  const { region, ruler } = eyepiece.marking.marks;
  if (region) return <RegionSays {...{ region, state, now }} />;
  return ruler && <RulerSays ruler={ruler} pitchPx={state.measurement?.micro_image_pitch_px ?? null} />;
}

function RegionSays({ region, state, now }: Pick<Given, "state" | "now"> & { region: Region }) {
  const words = strings.measuring;
  const facts = eyepiece.marking.region;
  const [spacing, grey] = [facts?.spacing ?? null, facts?.grey ?? null];
  const places = spacing ? digits(spacing.sigmaPx) : 0;
  const { reading, missing } = state;
  // What the meter has no figure for has none in a part of the frame either.
  const several = ofSeveral(reading);
  const elsewhere = spacing !== null && isOfAnotherPlace(spacing.frameSeq, state.measurement, reading);
  const spacingOld = missing !== null || isMeterOld(state, now) || reading?.settled === false || elsewhere;
  const greyOld = pictureState(state, now) !== "fresh" || isFrozen(state, now);
  return (
    <p class="facts measured" id="region">
      <b>{words.region(region.width, region.height, region.x, region.y)}</b>
      {several ? (
        <span>{strings.meter.words[several.direction]}</span>
      ) : spacing ? (
        <span class="measured-part" data-old={spacingOld}>
          {spacingOld && <span class="tag old">{words.old}</span>}
          <span title={words.spacingMore}>
            {words.spacing(fixed(spacing.spacingPx, places), fixed(spacing.sigmaPx, places))}
          </span>
          <span>{words.difference(signed(spacing.spacingPx - spacing.targetPx, places))}</span>
          <span>{words.of(spacing.lenses, spacing.frameSeq)}</span>
        </span>
      ) : (
        <span>{words.spacingNone}</span>
      )}
      {grey ? (
        <span class="measured-part" data-old={greyOld}>
          {greyOld && <span class="tag old">{words.old}</span>}
          <span>{words.grey(fixed(grey.mean, 1), grey.least, grey.most)}</span>
          <span>{words.saturated(fixed(100 * grey.saturated, 2))}</span>
        </span>
      ) : (
        <span>{words.greyNone}</span>
      )}
    </p>
  );
}

function RulerSays({ ruler, pitchPx }: { ruler: Ruler; pitchPx: number | null }) {
  const words = strings.measuring;
  const px = lengthOf(ruler);
  return (
    <p class="facts measured" id="distance">
      <b>{words.distance(fixed(px, 1))}</b>
      {pitchPx !== null && pitchPx > 0 && <span>{words.lenses(fixed(px / pitchPx, 2))}</span>}
      <span>{words.along(fixed(ruler.to.x - ruler.from.x, 0), fixed(ruler.to.y - ruler.from.y, 0))}</span>
    </p>
  );
}
