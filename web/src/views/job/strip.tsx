import * as api from "../../api";
import { addressOf } from "../../route";
import { currentJob, isFinal } from "../../state";
import { strings } from "../../strings";
import type { Scene } from "../scene";
import { OperatorStep } from "./operator-step";
import { Progress } from "./progress";
import { WayOn } from "./way-on";

/** The job under way, beside the picture. */
export function JobStrip(scene: Scene) {
  const { state, act } = scene;
  const job = currentJob(state);
  if (!job) return null;
  const over = isFinal(job.state);
  return (
    <section class="card strip" data-state={job.state} aria-label={strings.job.title}>
      <h2>
        {strings.job.kinds[job.kind]}
        <span class={`outcome ${job.state}`}>{strings.job.state[job.state]}</span>
        <a href={addressOf("alignment")}>{strings.job.see}</a>
      </h2>
      {!over && <Progress job={job} unit={state.preferences.unit} />}
      <OperatorStep {...scene} job={job} />
      {over && <WayOn {...scene} job={job} />}
      {!over && (
        <button
          type="button"
          disabled={job.state === "cancelling"}
          onClick={() => void act(api.cancelJob(job))}
        >
          {strings.job.cancel}
        </button>
      )}
    </section>
  );
}
