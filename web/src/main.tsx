import "uplot/dist/uPlot.min.css";
import "./style.css";
import { render } from "preact";
import { Live } from "./live";
import { initial, receive, receivePicture, type State } from "./state";
import { App } from "./views/app";
import { drawPicture } from "./views/picture";

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
    render(<App state={state} now={Date.now()} update={(change) => set({ ...state, ...change })} />, root);
  }, 30);
}

const scheme = location.protocol === "https:" ? "wss" : "ws";
const live = new Live(`${scheme}://${location.host}/api/v1/ws`, {
  link: (link) => set({ ...state, link }),
  message: (message) => set(receive(state, message, Date.now())),
  picture: async (picture) => {
    if (await drawPicture(picture.jpeg)) set(receivePicture(state, picture.facts, Date.now()));
  },
});
live.start();
// Ages grow without any message.
setInterval(() => set(state), 500);
set(state);
