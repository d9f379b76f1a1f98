import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { spoken } from "../words/language";
import { strings } from "../strings";
import { jobUnderWay, turnOf, type State } from "../state";
import type { Problem, TokenRequest } from "../daemon/wire";
import { AskName } from "./ask-name";
import { Header } from "./header";
import { DesignPage } from "./design/page";
import { HistoryPage } from "./history/page";
import { AlignmentPage } from "./job/page";
import { mayConfirm } from "./job/turn";
import { LivePage } from "./live/page";
import { MeterPage } from "./meter/page";
import { ProblemLine } from "./problem";
import type { Act, Given } from "./given";
import { Secret } from "./secret";
import { SettingsPage } from "./settings/page";
import { SignIn } from "./sign-in";

interface Props {
  state: State;
  newest: () => State;
  now: number;
  update: (change: Partial<State>) => void;
  enter: (key: string) => Promise<Problem | null>;
  leave: () => Promise<void>;
  makeToken: (token: TokenRequest) => Promise<boolean>;
  handed: boolean;
}

const VIEWS = {
  live: LivePage,
  alignment: AlignmentPage,
  design: DesignPage,
  history: HistoryPage,
  settings: SettingsPage,
  meter: MeterPage,
} as const;

export function App({ state, newest, now, update, enter, leave, makeToken, handed }: Props) {
  const act: Act = async (request) => {
    const result = await request;
    update({ problem: result.ok ? null : result.problem });
    return result.ok;
  };
  const load: Act = async (request) => {
    const result = await request;
    if (!result.ok && newest().problem === null) update({ problem: result.problem });
    return result.ok;
  };
  const simulated = state.bench?.simulated ?? false;
  const replayed = state.bench?.camera.replay ?? false;
  const where = state.session === "stranger" ? strings.signIn.signIn : strings.pages[state.route.page];
  // What may be old calls nobody.
  const asking = state.link !== "open" || turnOf(state) === null ? null : jobUnderWay(state);
  const lost = state.link === "lost";
  const turn = asking && (mayConfirm(state, asking) ? "yours" : "operators");
  const { language } = spoken;
  const page = useRef(state.route.page);
  useLayoutEffect(() => {
    // Another page is not where the last one was left.
    if (page.current !== state.route.page) window.scrollTo(0, 0);
    page.current = state.route.page;
  }, [state.route.page]);
  useEffect(() => {
    document.documentElement.lang = language;
    document.title = strings.windowTitle(where, simulated, replayed, lost ? "lost" : turn);
  }, [simulated, replayed, where, turn, lost, language]);
  if (state.session === "stranger") {
    return (
      <>
        <header>
          <div class="bar">
            <h1>{strings.title}</h1>
          </div>
          {state.problem && <ProblemLine problem={state.problem} dismiss={() => update({ problem: null })} />}
          {state.made && <Secret made={state.made} kept={() => update({ made: null })} />}
        </header>
        <main class="alone">
          <SignIn out={state.out} handed={handed} enter={enter} />
        </main>
      </>
    );
  }
  const given: Given = { state, newest, now, update, act, load, makeToken };
  const View = VIEWS[state.route.page];
  return (
    <>
      <Header {...given} leave={() => void leave()} />
      {state.route.page !== "meter" && <AskName {...given} />}
      <main id="content" tabIndex={-1} data-link={state.link} data-page={state.route.page}>
        <View {...given} />
      </main>
    </>
  );
}
