import "uplot/dist/uPlot.min.css";
import "./style/index.css";
import { render } from "preact";
import * as api from "./daemon/api";
import { awake } from "./browser/awake";
import { Belongings } from "./daemon/belongings";
import { Cadence, LEISURELY_MS, SOON_MS } from "./browser/cadence";
import { isBrokenLink, keyOfAddress, type ConfirmKey } from "./daemon/confirm-key";
import { keepToOne } from "./daemon/copies";
import { eyepiece } from "./picture/eyepiece";
import { watchFocus } from "./browser/focus";
import { install } from "./browser/install";
import { jog, watchJog } from "./bench/jogging";
import { callMe } from "./words/names";
import { needle } from "./meter/needle";
import { pageNow } from "./browser/page-clock";
import { keep, named, recall } from "./preferences";
import { addressOf, routeOf } from "./browser/route";
import { keyOfLink, signIn, signOut, whoAmI, whyOut } from "./daemon/session";
import { receive, receivePicture, receiveReading, remember } from "./received";
import { endsPress, initial, turnOf, type State } from "./state";
import { drawable, overlaysOn } from "./picture/show";
import { setUpAt } from "./meter/set-up";
import { strings } from "./strings";
import { sound } from "./browser/sound";
import { stop, watchStopKey } from "./bench/stopping";
import { toneNow } from "./meter/tone";
import { watchToneKey } from "./meter/tone-key";
import type { Report } from "./picture/viewer";
import { App } from "./views/app";
import type { Problem, TokenRequest } from "./daemon/wire";
import { lookedAt, wishOf } from "./daemon/wish";

const ASK_AGAIN_MS = 2000;
/** Between two looks at whether the tone still holds. */
const TONE_MS = 250;

/** Takes the confirm key of a link that has opened the page, so that it is neither in the address bar nor in the history. */
function takeConfirmKey(): void {
  const found = keyOfAddress(location.hash);
  broken = found === null && isBrokenLink(location.hash);
  if (broken) history.replaceState(null, "", addressOf("alignment"));
  if (found === null) return;
  handed = found;
  history.replaceState(null, "", addressOf("alignment", found.job));
  api.confirmKeys.keep(handed);
}

/** The confirm key that whoever is here has come with. */
let handed: ConfirmKey | null = null;
/** Whether the link that has opened the page is none as it was made. */
let broken = false;
const brokenLink = (): Problem | null => (broken ? { ...strings.job.brokenLink, type: "", status: 0 } : null);
const belongings = new Belongings(sessionStorage, () => {
  api.lease.abandon();
  api.confirmKeys.forget();
  if (handed) api.confirmKeys.keep(handed);
});

takeConfirmKey();
keepToOne(api.lease, performance.timeOrigin);
/** The newest reset of the stop that was read here is no news after a reload. */
const RESET_SEEN = "plenalign.reset-seen";
let state: State = {
  ...initial,
  route: routeOf(location.hash),
  problem: brokenLink(),
  preferences: recall(localStorage),
  resetSeen: sessionStorage.getItem(RESET_SEEN),
};
const root = document.getElementById("app");
const cadence = new Cadence(() => {
  if (!root) return;
  const now = pageNow();
  render(<App {...{ state, newest, now, update, enter, leave, makeToken, handed: handed !== null }} />, root);
});
const newest = () => state;
const update = (change: Partial<State>) => set({ ...state, ...change });

/** The state from now on; what is shown of it follows soon, however many messages come. */
function set(next: State, everyMs = SOON_MS): void {
  const before = state;
  state = next;
  if (next.preferences !== before.preferences) keep(localStorage, next.preferences, before.preferences);
  if (next.resetSeen !== null && next.resetSeen !== before.resetSeen)
    sessionStorage.setItem(RESET_SEEN, next.resetSeen);
  if (endsPress(before, next)) jog.release();
  const turn = turnOf(next);
  if (next.preferences.call && turn !== null && turn !== turnOf(before)) sound.call();
  heed();
  cadence.due(everyMs);
}

/** The state with how control of the bench was lost to this page; what is held down is let go of by that. */
function withControl(next: State): State {
  if (!next.bench || next.bench === state.bench) return next;
  const heard = api.lease.heard(next.bench.lease ?? null);
  if (heard === null) return next;
  if (heard === "mine") return next.controlLost === null ? next : { ...next, controlLost: null };
  jog.release();
  return { ...next, controlLost: heard };
}

/** What follows from the state for those outside of it. */
function heed(): void {
  const { preferences, session, route } = state;
  callMe(preferences.name || (session && session !== "stranger" && session.signed_in ? session.name : ""));
  const now = pageNow();
  sound.play(toneNow(state, now));
  void awake.want(preferences.awake && document.visibilityState === "visible", now);
  const overlays = overlaysOn(preferences.show, preferences.overlays);
  eyepiece.showOverlays(drawable(overlays, state.reading));
  eyepiece.want(
    wishOf(lookedAt(route, document.visibilityState === "visible"), {
      // Of a region the spacing is told, too.
      overlay:
        overlays.some((overlay) => overlay !== "saturation") ||
        (preferences.show === "raw" && eyepiece.marking.marks.region !== null),
      show: preferences.show,
    }),
  );
}

/** Silences the tone once its reading is old: nothing need come that says so. */
setInterval(() => sound.play(toneNow(state, pageNow())), TONE_MS);

/** What the viewer reports. */
function receiveReport(report: Report): void {
  // What was on its way when somebody signed out is not for the next one.
  if (state.session === "stranger" && report.is !== "link") return;
  switch (report.is) {
    case "link":
      set({ ...state, link: report.link, retryAt: report.nextAt });
      void identify();
      return;
    case "message": {
      const { message, cameAt } = report;
      // Another run of the daemon may have another design, and another camera.
      if (message.type === "snapshot" && state.bootId !== null && state.bootId !== message.boot_id) {
        eyepiece.forget();
        void learnDesign();
      }
      const next = withControl(receive(state, message, cameAt));
      if (setUpAt(next.bench) !== setUpAt(state.bench)) eyepiece.forgetMap();
      set(next);
      if (message.type === "snapshot") void learnRecent();
      return;
    }
    case "picture":
      set(receivePicture(state, report.facts, report.sentAt, pageNow()), LEISURELY_MS);
      return;
    case "reading":
      // Nothing but the meter's own drawing follows from it.
      state = receiveReading(state, report.reading, report.cameAt);
      needle.moved();
      return;
    case "alive":
      api.lease.due();
      return;
    case "map":
    case "saturation":
      cadence.due(LEISURELY_MS);
  }
}

/** A sign-in under way: until it has ended it is not known who one is. */
let entering: Promise<unknown> | null = null;

/** Finds out who one is; to a stranger the daemon says nothing more, so that nothing is asked of it. */
async function identify(): Promise<void> {
  await entering;
  const who = await whoAmI();
  if (who.is === "known") {
    // How control ended is told to who had it.
    const lost = belongings.cameIn(who.session) ? null : state.controlLost;
    set({ ...state, session: who.session, out: null, controlLost: lost });
    void learnDesign();
  }
  if (who.is === "stranger") {
    eyepiece.close();
    api.lease.left();
    if (state.session !== null && state.session !== "stranger") handed = null;
    // Nothing that was shown to somebody is left for the next one.
    const { route, preferences, made } = state;
    const out = whyOut(state.session, who.ended, state.out);
    // That a token has ended is said once: the command that was refused for it says no more.
    const problem = who.ended === null ? state.problem : null;
    set({ ...initial, problem, route, preferences, made, session: "stranger", out });
    eyepiece.forget();
    return;
  }
  eyepiece.open();
  // Nothing is offered to who is not known: asked again until it is.
  if (who.is === "unclear" && state.session === null) setTimeout(() => void identify(), ASK_AGAIN_MS);
}

/** The last two minutes; the charts begin empty where they cannot be had. */
async function learnRecent(): Promise<void> {
  const recent = await api.recent();
  if (recent.ok && state.session !== "stranger") set(remember(state, recent.value, pageNow()));
}

/** The design's figures; the page does without where they cannot be had. */
async function learnDesign(): Promise<void> {
  const design = await api.design();
  if (design.ok) set({ ...state, design: design.value });
}

async function enter(key: string): Promise<Problem | null> {
  const problem = await signIn(key);
  if (problem !== null) return problem;
  // What went wrong for whoever was here before is not said to the next one.
  set({ ...state, problem: null });
  await identify();
  return null;
}

/** With the first token everybody is asked for one: this browser signs in with it before it is turned away. */
async function makeToken(token: TokenRequest): Promise<boolean> {
  const { session } = state;
  const first = session !== null && session !== "stranger" && !session.demanded;
  const making = api.makeToken(token);
  const signing = making.then((made) => (first && made.ok ? signIn(made.value.secret) : null));
  entering = signing;
  const [made, problem] = await Promise.all([making, signing]);
  entering = null;
  set({ ...state, ...(made.ok ? { made: made.value, problem } : { problem: made.problem }) });
  if (first) await identify();
  return made.ok;
}

async function leave(): Promise<void> {
  // Control is not for whoever signs in here next. While a job has it, it is kept: whoever comes back answers with it.
  if (!state.bench?.lease?.job) {
    const released = await api.releaseLease();
    if (!released.ok) return update({ problem: released.problem });
  }
  await signOut();
  await identify();
}

async function begin(): Promise<void> {
  const key = keyOfLink(location);
  if (key !== null) {
    // Not in the history, and not in what is copied from the address bar.
    history.replaceState(null, "", "/");
    const problem = await signIn(key);
    if (problem) set({ ...state, problem });
  }
  await identify();
}

eyepiece.start(receiveReport, () => {
  heed();
  cadence.due(SOON_MS);
});
document.addEventListener("visibilitychange", heed);
watchFocus();
watchJog((problem) => update({ problem }));
watchStopKey(
  () => state.preferences.stopKey,
  () => state.session !== "stranger",
  () => void stop(update, newest),
);
install.watch(() => cadence.due(SOON_MS));
watchToneKey(() => update({ tone: !state.tone }));
// Its secret is shown only now: a reload would lose it.
window.addEventListener("beforeunload", (event) => state.made && event.preventDefault());
// Asked for once in a browser, however many of its tabs are open.
window.addEventListener("storage", () => {
  const preferences = named(state.preferences, recall(localStorage));
  if (preferences !== state.preferences) update({ preferences });
});
window.addEventListener("hashchange", () => {
  takeConfirmKey();
  update({ route: routeOf(location.hash), problem: brokenLink() });
});
void begin();
// Ages grow without any message.
setInterval(() => cadence.due(LEISURELY_MS), 500);
set(state);
