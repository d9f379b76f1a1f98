// The viewer in a worker.

import { followPage } from "../browser/page-clock";
import { Viewer, type Command, type Report } from "./viewer";

/** What the page tells its worker: what its clock is, ms, beside what the viewer is to do. */
export type Word = Command | { do: "clock"; at: number };

/** The worker's own scope, as far as it is used here. */
interface Scope {
  onmessage: ((event: MessageEvent<Word>) => void) | null;
  postMessage(report: Report): void;
}

const scope = globalThis as unknown as Scope;
const viewer = new Viewer((report) => scope.postMessage(report));
scope.onmessage = ({ data }) => (data.do === "clock" ? followPage(data.at) : viewer.obey(data));
