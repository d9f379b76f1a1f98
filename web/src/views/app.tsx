import { useEffect } from "preact/hooks";
import * as api from "../api";
import type { State } from "../state";
import { strings } from "../strings";
import type { Problem } from "../wire";
import { Axes } from "./axes";
import { Iterations, JobCard } from "./job";
import { LivePicture } from "./picture";
import { SignIn, Who } from "./sign-in";
import { Spacing } from "./spacing";

/** Carries a request out and shows its problem if it has one. */
export type Act = (request: Promise<api.Result<unknown>>) => Promise<void>;

interface Props {
  state: State;
  now: number;
  update: (change: Partial<State>) => void;
  enter: (key: string) => Promise<Problem | null>;
  leave: () => Promise<void>;
}

export function App({ state, now, update, enter, leave }: Props) {
  const act: Act = async (request) => {
    const result = await request;
    update({ problem: result.ok ? null : result.problem });
  };
  const simulated = state.bench?.simulated ?? false;
  useEffect(() => {
    document.title = simulated ? strings.simulatedTitle : strings.title;
  }, [simulated]);
  if (state.session === "stranger") {
    return (
      <>
        <header>
          <div class="bar">
            <h1>{strings.title}</h1>
          </div>
          {state.problem && <ProblemLine problem={state.problem} dismiss={() => update({ problem: null })} />}
        </header>
        <main class="alone">
          <SignIn enter={enter} />
        </main>
      </>
    );
  }
  return (
    <>
      <header>
        {simulated && (
          <p class="simulated" role="note">
            <b>{strings.simulated}</b> <span>{strings.simulatedMore}</span>
          </p>
        )}
        {state.bench?.camera.replay && (
          <p class="simulated" role="note">
            <b>{strings.replay}</b> <span>{strings.replayMore}</span>
          </p>
        )}
        <div class="bar">
          <h1>{strings.title}</h1>
          <p class="design">{state.bench?.design_origin}</p>
          {state.session && <Who session={state.session} leave={() => void leave()} />}
          <Stop state={state} update={update} act={act} />
        </div>
        {state.link !== "open" && (
          <p class="link" role="status" data-link={state.link}>
            {state.link === "lost" ? strings.lost : strings.connecting}
          </p>
        )}
        {state.bench?.history_fault && (
          <p class="problem" role="alert" id="history-fault">
            <span>
              <b>{strings.historyFault}.</b> {state.bench.history_fault}
            </span>
          </p>
        )}
        {state.problem && <ProblemLine problem={state.problem} dismiss={() => update({ problem: null })} />}
      </header>
      <main data-link={state.link}>
        <LivePicture state={state} now={now} />
        <div class="side">
          <Spacing state={state} now={now} />
          <Axes state={state} act={act} />
        </div>
        <JobCard state={state} act={act} />
        <Iterations state={state} />
      </main>
    </>
  );
}

function Stop({ state, update, act }: Pick<Props, "state" | "update"> & { act: Act }) {
  const stop = async () => {
    const result = await api.stopAll();
    if (!result.ok) return update({ problem: result.problem });
    const { focus, e } = result.value;
    const detail = strings.stopSent(strings.delivery[focus], strings.delivery[e]);
    return update({ problem: { type: "about:blank", title: strings.stopped, status: 200, detail } });
  };
  const latched = state.bench?.stop.latched ?? false;
  return (
    <div class="stop">
      {latched && (
        <p role="alert">
          <b>{strings.stopped}.</b> <span>{strings.stoppedMore}</span>{" "}
          <button id="reset" onClick={() => void act(api.resetStop())}>
            {strings.resetStop}
          </button>
        </p>
      )}
      <button id="stop" title={strings.stopMore} onClick={() => void stop()}>
        {strings.stop}
      </button>
    </div>
  );
}

function ProblemLine({ problem, dismiss }: { problem: Problem; dismiss: () => void }) {
  return (
    <p class="problem" role="alert">
      <span>
        <b>{problem.title}.</b> {problem.detail}
      </span>
      <button onClick={dismiss}>{strings.dismiss}</button>
    </p>
  );
}
