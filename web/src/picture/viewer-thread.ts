// Where the viewer works: in a worker, or in the page itself where a worker cannot draw.

import { pageNow } from "../browser/page-clock";
import type { Command, Report, Viewer } from "./viewer";
import type { Word } from "./viewer-worker";

/** After so many checks without a sign of life, a worker has none: checks, unlike clocks, stand still in a computer that
 *  sleeps. */
const CHECKS = 6;
const CHECK_MS = 1000;

/** Whether a worker can draw on a canvas of the page. */
export function canDrawInWorker(): boolean {
  return (
    typeof Worker !== "undefined" &&
    typeof OffscreenCanvas !== "undefined" &&
    "transferControlToOffscreen" in HTMLCanvasElement.prototype
  );
}

export class ViewerThread {
  private worker: Worker | null = null;
  private viewer: Promise<Viewer> | null = null;
  private silent = 0;
  /** What a new worker is to be told, one of a kind. */
  private readonly standing = new Map<string, Command>();

  /** `restarted` is called when a worker that said nothing any more was replaced, and what it drew on with it. */
  constructor(
    private readonly report: (report: Report) => void,
    private readonly restarted: () => void,
  ) {
    if (!canDrawInWorker()) {
      this.viewer = import("./viewer").then(({ Viewer }) => new Viewer(report));
      return;
    }
    this.worker = this.start();
    setInterval(() => this.check(), CHECK_MS);
  }

  post(command: Command, transfer: Transferable[] = []): void {
    if (command.do === "open" || command.do === "close") this.standing.set("open", command);
    const { do: kind } = command;
    if (kind === "want" || kind === "overlay" || kind === "look" || kind === "mark") {
      this.standing.set(kind, command);
    }
    void this.viewer?.then((viewer) => viewer.obey(command));
    this.worker?.postMessage(command, transfer);
  }

  /** Has a canvas drawn on. */
  attach(canvas: HTMLCanvasElement, over: HTMLCanvasElement): void {
    if (this.viewer) return this.post({ do: "attach", canvas, over });
    const surfaces = { canvas: canvas.transferControlToOffscreen(), over: over.transferControlToOffscreen() };
    this.post({ do: "attach", ...surfaces }, [surfaces.canvas, surfaces.over]);
  }

  private start(): Worker {
    const worker = new Worker(new URL("./viewer-worker.ts", import.meta.url), { type: "module" });
    worker.onmessage = (event: MessageEvent<Report>) => {
      this.silent = 0;
      this.report(event.data);
    };
    tellClock(worker);
    return worker;
  }

  /** A worker that says nothing is none: without it there would be neither a picture nor a word of the daemon. */
  private check(): void {
    this.silent += 1;
    if (this.worker) tellClock(this.worker);
    if (this.silent < CHECKS || !this.worker) return;
    this.silent = 0;
    this.worker.terminate();
    this.report({ is: "link", link: "lost", nextAt: null });
    this.worker = this.start();
    for (const command of this.standing.values()) this.worker.postMessage(command);
    this.restarted();
  }
}

function tellClock(worker: Worker): void {
  worker.postMessage({ do: "clock", at: pageNow() } satisfies Word);
}
