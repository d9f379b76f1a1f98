import { addressOf } from "../../browser/route";
import { currentJob, isFinal } from "../../state";
import { strings } from "../../strings";
import type { Given } from "../given";
import { Old } from "../old";
import { MovedSince } from "./moved-since";
import { Progress } from "./progress";
import { Turn } from "./turn";
import { WayOn } from "./way-on";

/** The job under way, beside the picture. */
export function JobStrip(given: Given) {
  const { state } = given;
  const job = currentJob(state);
  if (!job) return null;
  const over = isFinal(job.state);
  return (
    <section class="card strip" data-state={job.state} data-over={over} aria-label={strings.job.title}>
      <h2>
        {strings.job.kinds[job.kind]}
        <span class={`outcome ${job.state}`}>{strings.job.state[job.state]}</span>
        {!over && <Old {...given} />}
        <a href={addressOf("alignment")}>{strings.job.see}</a>
      </h2>
      {!over && <Turn key={job.id} {...given} job={job} />}
      {!over && <Progress job={job} unit={state.preferences.unit} />}
      {over && <MovedSince {...given} job={job} />}
      {over && <WayOn {...given} job={job} />}
    </section>
  );
}
