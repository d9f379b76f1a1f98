import * as api from "../../api";
import { may } from "../../state";
import { strings } from "../../strings";
import { wayOn } from "../../way-on";
import type { Job } from "../../wire";
import type { Scene } from "../scene";

/** After a job that ended early: what still holds of it, and the buttons to go on. */
export function WayOn({ state, act, job }: Scene & { job: Job }) {
  const on = wayOn(job, state.bench);
  if (!on || !may(state, "control")) return null;
  const words = strings.wayOn;
  const stopped = state.bench?.stop.latched ?? false;
  const ready = Boolean(state.bench) && !stopped && state.link === "open";
  return (
    <div class="way-on" role="group" aria-label={words.title}>
      <h3>{words.title}</h3>
      {on.airStep && <p>{words.airStep[on.airStep]}</p>}
      {stopped && <p>{words.resetFirst}</p>}
      <p class="actions">
        {on.ways.map(({ is, request }, index) => (
          <button
            key={is}
            type="button"
            class={index === 0 ? "primary" : undefined}
            data-way={is}
            disabled={!ready}
            title={strings.job.meaning[request.kind]}
            onClick={() => void act(api.startJob(request))}
          >
            {words[is](strings.job.kinds[request.kind])}
          </button>
        ))}
      </p>
    </div>
  );
}
