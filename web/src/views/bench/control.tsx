import { PACES, type Pace } from "../../bench/pace";
import { STEPS_MM } from "../../preferences";
import * as api from "../../daemon/api";
import { able, may } from "../../state";
import { another } from "../../words/names";
import { strings } from "../../strings";
import { plain } from "../../words/units";
import { useState } from "preact/hooks";
import { Old } from "../old";
import type { Given } from "../given";
import { Choice } from "../toggle";
import { AxisScale } from "./axis";
import { ByHand } from "./by-hand";
import { Shell } from "./shell";

/** The axes, and what moves them by hand. */
export function Bench(given: Given) {
  const { state, update } = given;
  const [pace, setPace] = useState<Pace>("slow");
  const bench = state.bench;
  if (!bench) return null;
  const { unit, stepMm } = state.preferences;
  const commanding = may(state, "control");
  const other = api.lease.other(bench.lease);
  // Nothing is moved that the history could not be given.
  const hindered = Boolean(bench.job || bench.stop.latched || bench.history_fault);
  const closed = hindered || !commanding || other !== null;
  return (
    <section class="card axes" aria-label={strings.byHand.title}>
      <h2 class="unseen">{strings.byHand.title}</h2>
      {state.session !== null && !commanding && <p class="quiet">{strings.viewOnly}</p>}
      {commanding && state.link === "open" && other !== null && (
        <p class="quiet">{strings.byHand.others(another(other, "first"))}</p>
      )}
      <p class="paces">
        <Old {...given} />
        <span class="named">
          <span class="quiet">{strings.byHand.step}</span>
          <Choice
            label={strings.byHand.step}
            of={STEPS_MM}
            chosen={stepMm}
            name={(step) => `${plain(step, unit)} ${unit}`}
            choose={(step) => update({ preferences: { ...state.preferences, stepMm: step } })}
          />
        </span>
        <span class="named">
          <span class="quiet">{strings.byHand.pace}</span>
          <Choice
            label={strings.byHand.pace}
            of={PACES}
            chosen={pace}
            name={(one) => strings.byHand.paces[one]}
            choose={setPace}
          />
        </span>
      </p>
      {bench.axes.map((axis) => (
        <div class="axis" data-axis={axis.axis} key={axis.axis}>
          <AxisScale bench={bench} axis={axis} unit={unit} />
          <ByHand {...given} axis={axis} pace={pace} closed={closed} />
        </div>
      ))}
      <p class="quiet hint">{strings.byHand.hint}</p>
      <Shell {...given} shell={bench.shell} disabled={closed || !able(state, "control")} />
    </section>
  );
}
