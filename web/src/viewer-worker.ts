// The viewer in a worker.

import { Viewer, type Command, type Report } from "./viewer";

/** The worker's own scope, as far as it is used here. */
interface Scope {
  onmessage: ((event: MessageEvent<Command>) => void) | null;
  postMessage(report: Report): void;
}

const scope = globalThis as unknown as Scope;
const viewer = new Viewer((report) => scope.postMessage(report));
scope.onmessage = (event) => viewer.obey(event.data);
