import { moment, sentence } from "../../words/format";
import { useEffect, useLayoutEffect, useRef, useState } from "preact/hooks";
import { isFocusLost } from "../../browser/focus";
import * as api from "../../daemon/api";
import { called } from "../../words/names";
import { addressOf } from "../../browser/route";
import { currentJob, isFinal } from "../../state";
import { reasonOf } from "../../job/reason";
import { strings } from "../../strings";
import { reworded } from "../../words/units";
import type { Job } from "../../daemon/wire";
import { Meter } from "../live/meter";
import { MovedSince } from "./moved-since";
import { Old } from "../old";
import { useConfigFile } from "../config-file";
import type { Given } from "../given";
import { Downloads } from "./downloads";
import { HandOn } from "./hand-on";
import { useInterrupted } from "./interrupted";
import { Iterations } from "./iterations";
import { Outcome } from "./outcome";
import { Progress } from "./progress";
import { Result } from "./result";
import { StartJob } from "./start";
import { Steps } from "./steps";
import { Turn } from "./turn";
import { WayOn } from "./way-on";

/** A job from its start to its report; one of earlier on where the address names it. */
export function AlignmentPage(given: Given) {
  const { state } = given;
  const named = state.route.jobs[0];
  const { unit } = state.preferences;
  const interrupted = useInterrupted(given);
  const present = currentJob(state) ?? interrupted;
  // The newest is none of earlier on, whoever names it.
  const asked = named === present?.id ? undefined : named;
  const { job: earlier, gone } = useEarlier(given, asked);
  const job = asked ? (state.jobs.find((job) => job.id === asked) ?? earlier) : present;
  const running = present !== null && !isFinal(present.state);
  const page = useHeir(running);
  return (
    <div class="job-page" ref={page}>
      <div class="column">
        {asked && (
          <p class="card earlier">
            {gone ? strings.job.gone : strings.job.earlier}{" "}
            <a href={addressOf("alignment")}>{strings.job.backToNow}</a>
          </p>
        )}
        {!asked && !running && <Waiting {...given} />}
        {job && <JobCard {...given} job={job} present={job === present} />}
        {!job && state.bench && !asked && (
          <p class="card job" data-state="none">
            {strings.job.none}
          </p>
        )}
        {!asked && !running && <StartJob {...given} />}
      </div>
      <div class="column">
        {!asked && <Meter {...given} />}
        {job?.report && <Result report={job.report} unit={unit} />}
        {job?.outcome && <Outcome outcome={job.outcome} unit={unit} />}
      </div>
      {job && <Iterations job={job} unit={unit} />}
    </div>
  );
}

/** What of the configuration's file is not in force yet: a job that is started now goes by what was before. */
function Waiting(given: Given) {
  const { file } = useConfigFile(given);
  if (file === null || file.waiting.length === 0) return null;
  return <p class="notice waiting">{strings.job.waiting(file.waiting.join(", "))}</p>;
}

/** A job that this page has not followed, or that there is none of that name; neither until the daemon has said. */
function useEarlier({ state, load }: Given, id: string | undefined): { job: Job | null; gone: boolean } {
  const [earlier, setEarlier] = useState<Job | null>(null);
  const [gone, lose] = useState<string | null>(null);
  const connected = state.link === "open";
  const followed = id !== undefined && state.jobs.some((job) => job.id === id);
  // What could not be asked while the daemon was away is asked when it is back.
  useEffect(() => {
    if (id === undefined || !connected || followed) return;
    void api.job(id).then((result) => {
      if (result.ok) setEarlier(result.value);
      else if (result.problem.status === 404) lose(id);
      else void load(Promise.resolve(result));
    });
  }, [id, connected, followed]);
  return { job: earlier?.id === id ? earlier : null, gone: gone === id };
}

/** Whoever is at a job's buttons when it ends, or when the daemon does, goes on from what it came to, once that is known. */
function useHeir(running: boolean) {
  const page = useRef<HTMLDivElement>(null);
  const [held] = useState({ heir: false });
  // Once this is drawn, what had the focus is gone.
  if (page.current?.querySelector(".turn")?.contains(document.activeElement)) held.heir = !running;
  useLayoutEffect(() => {
    const card = page.current?.querySelector<HTMLElement>("section.job");
    if (!held.heir || !card) return;
    held.heir = false;
    if (isFocusLost()) card.focus({ preventScroll: true });
  });
  return page;
}

function JobCard(given: Given & { job: Job; present: boolean }) {
  const { job, present } = given;
  const over = isFinal(job.state);
  const { unit } = given.state.preferences;
  const reason = reasonOf(job);
  return (
    <section class="card job" tabIndex={-1} aria-label={strings.job.title} data-state={job.state}>
      <h2>
        {strings.job.kinds[job.kind]}
        <span class={`outcome ${job.state}`} data-reason={over && reason !== null}>
          {strings.job.state[job.state]}
        </span>
        {!over && <Old {...given} />}
      </h2>
      <p class="quiet">
        {strings.job.byWhom(called(job.owner ?? ""), moment(job.created_at))}
        {job.request.note && ` · ${job.request.note}`}
        {!over && job.recording?.state === "recording" && ` · ${strings.job.recordingNow}`}
      </p>
      {!over && job.recording?.state === "failed" && (
        <p class="notice wrong">{strings.job.recordingEnded(job.recording.fault ?? null)}</p>
      )}
      {!over && <Turn key={job.id} {...given} />}
      {!over && <Progress job={job} unit={unit} />}
      {over && reason !== null && (
        <p class="reason" lang="en">
          {sentence(reworded(reason, unit))}
        </p>
      )}
      {present && <MovedSince {...given} />}
      <Steps {...given} />
      {present && <WayOn {...given} />}
      {!over && <HandOn {...given} />}
      {over && <Downloads href={job.href} recording={job.recording} />}
    </section>
  );
}
