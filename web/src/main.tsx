import "uplot/dist/uPlot.min.css";
import "./style.css";
import { render } from "preact";
import { Live } from "./live";
import { keyOfLink, signIn, signOut, whoAmI } from "./session";
import { initial, receive, receivePicture, type State } from "./state";
import { App } from "./views/app";
import { drawPicture } from "./views/picture";
import type { Problem } from "./wire";

let state: State = initial;
let scheduled = false;
const root = document.getElementById("app");

/** Draws at most once per display frame, however many messages come. */
function set(next: State): void {
  state = next;
  if (scheduled || !root) return;
  scheduled = true;
  setTimeout(() => {
    scheduled = false;
    const update = (change: Partial<State>) => set({ ...state, ...change });
    render(<App state={state} now={Date.now()} update={update} enter={enter} leave={leave} />, root);
  }, 30);
}

const scheme = location.protocol === "https:" ? "wss" : "ws";
const live = new Live(`${scheme}://${location.host}/api/v1/ws`, {
  link: (link) => {
    set({ ...state, link });
    void identify();
  },
  message: (message) => set(receive(state, message, Date.now())),
  picture: async (picture) => {
    if (await drawPicture(picture.jpeg)) set(receivePicture(state, picture.facts, Date.now()));
  },
});

/** Finds out who one is; to a stranger the daemon says nothing more, so that nothing is asked of it. */
async function identify(): Promise<void> {
  const who = await whoAmI();
  if (who.is === "known") set({ ...state, session: who.session });
  if (who.is === "stranger") {
    live.close();
    // Nothing that was shown to somebody is left for the next one.
    set({ ...initial, problem: state.problem, session: "stranger" });
    return;
  }
  live.open();
}

async function enter(key: string): Promise<Problem | null> {
  const problem = await signIn(key);
  if (problem === null) await identify();
  return problem;
}

async function leave(): Promise<void> {
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

live.start();
void begin();
// Ages grow without any message.
setInterval(() => set(state), 500);
set(state);
