import { eyepiece } from "../picture/eyepiece";
import { sentence, wait } from "../words/format";
import { addressOf, PAGES } from "../browser/route";
import { isFrozen } from "../state";
import { strings } from "../strings";
import { Absences } from "./absences";
import { ControlGone, Lease } from "./bench/lease";
import { ProblemLine } from "./problem";
import type { Given } from "./given";
import { Call } from "./job/call";
import { Secret } from "./secret";
import { Who } from "./sign-in";
import { Stop, StopNotices } from "./stop";

/** What is seen whatever page is open: that it is simulated, whether it is connected, who has control, STOP. */
export function Header({ leave, ...given }: Given & { leave: () => void }) {
  const { state, update } = given;
  const bench = state.bench;
  const alone = state.route.page === "meter";
  return (
    <header data-alone={alone}>
      <a class="skip" href="#content" onClick={(event) => skip(event)}>
        {strings.skip}
      </a>
      {bench?.simulated && (
        <p class="simulated" role="note">
          <b>{strings.simulated}</b>{" "}
          <span>{bench.camera.replay ? strings.simulatedAxes : strings.simulatedMore}</span>
        </p>
      )}
      {bench?.camera.replay && (
        <p class="simulated" role="note">
          <b>{strings.replay}</b> <span>{strings.replayMore}</span>
        </p>
      )}
      <div class="bar">
        <h1>{strings.title}</h1>
        {alone ? (
          <nav aria-label={strings.pagesLabel}>
            <a href={addressOf("live")}>{strings.meterPage.back}</a>
          </nav>
        ) : (
          <nav aria-label={strings.pagesLabel}>
            {PAGES.map((page) => (
              <a
                key={page}
                href={addressOf(page)}
                aria-current={state.route.page === page ? "page" : undefined}
              >
                {strings.pages[page]}
              </a>
            ))}
          </nav>
        )}
        {!alone && <Lease {...given} />}
        {!alone && state.session && state.session !== "stranger" && (
          <Who session={state.session} leave={leave} />
        )}
        <Stop {...given} />
      </div>
      <StopNotices {...given} />
      {state.link !== "open" && (
        <div class="link" data-link={state.link}>
          <p role="status">
            {state.link === "lost" ? (
              <>
                <b>{strings.lost}</b> <span>{strings.lostMore}</span>
              </>
            ) : (
              strings.connecting
            )}
          </p>
          {state.link === "lost" && <Retry {...given} />}
        </div>
      )}
      {!alone && <Call state={state} />}
      {state.controlLost && <ControlGone {...given} lost={state.controlLost} />}
      {bench && state.link === "open" && <Absences bench={bench} frozen={isFrozen(state, given.now)} />}
      {bench?.history_fault && (
        <div class="problem" role="alert" id="history-fault">
          <p>
            <b>{strings.historyFault}.</b> <span lang="en">{sentence(bench.history_fault)}</span>
          </p>
        </div>
      )}
      {state.made && <Secret made={state.made} kept={() => update({ made: null })} />}
      {state.problem && (
        <ProblemLine
          problem={state.problem}
          unit={state.preferences.unit}
          dismiss={() => update({ problem: null })}
        />
      )}
    </header>
  );
}

/** When it is tried again, and how to have it tried at once. */
function Retry({ state, now }: Given) {
  const left = state.retryAt === null ? 0 : state.retryAt - now;
  return (
    <span class="retry">
      {/* A count of seconds is not for the ear. */}
      <span aria-hidden="true">{left > 0 ? strings.retryIn(wait(left / 1000)) : strings.retrying}</span>
      <button type="button" id="retry" onClick={() => eyepiece.retry()}>
        {strings.retryNow}
      </button>
    </span>
  );
}

/** The address after the # names the page that is seen, and stays. */
function skip(event: Event): void {
  event.preventDefault();
  document.getElementById("content")?.focus();
}
