import { signed } from "../../words/format";
import { digits } from "../../meter/scale";
import { bestAnew } from "../../meter/reading";
import { strings } from "../../strings";
import { length } from "../../words/units";
import type { Given } from "../given";
import { Explained } from "../term";

/** Peak hold: the best that was read, and where the axes stood. */
export function BestHeld({ state, update }: Given) {
  const held = state.best;
  if (!held) return null;
  const at = (mm: number | null) => (mm === null ? strings.axis.unknown : length(mm, state.preferences.unit));
  const anew = () => update({ best: bestAnew(state) });
  return (
    <div class="best-held">
      <p>
        <b>{strings.meter.best(signed(held.differencePx, digits(held.sigmaPx)))}</b>
        <br />
        <span class="quiet">
          <Explained
            text={
              held.focusMm === null && held.eMm === null
                ? strings.meter.bestNowhere
                : strings.meter.bestMore(at(held.focusMm), at(held.eMm))
            }
          />
        </span>
      </p>
      <button type="button" onClick={anew}>
        {strings.meter.bestReset}
      </button>
    </div>
  );
}
