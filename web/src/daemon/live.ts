// The WebSocket's one driver: keeps a connection, reads what comes, asks for pictures and for what the meter reads, and says
// when pictures were drawn.

import { COARSE, EVERY, instead, sameAim, type Aim } from "./aim";
import {
  parseMessage,
  parseSeen,
  type FieldMap,
  type FrameReading,
  type Picture,
  type Problem,
  type ServerMessage,
  type ViewerMessage,
} from "./wire";
import { pageNow } from "../browser/page-clock";
import type { Link } from "../state";
import type { Wish } from "./wish";

/** Signs of life come every second: after so many checks in silence the connection is lost, which is within 3 s of it.
 *  Checks, unlike clocks, stand still in a computer that sleeps, and do not run ahead of messages that wait to be read. */
const CHECK_MS = 250;
const CHECKS = 11;
/** Until a connection is there, so many are waited for. */
const CHECKS_CONNECTING = 20;
const FIRST_RETRY_MS = 500;
const LONGEST_RETRY_MS = 5000;
/** Pictures on the way: one is drawn while the next one travels. */
const WINDOW = 2;
/** Where drawing takes longer than this, ms, the one that travels would wait, and be old when it is drawn. */
const SLOW_MS = 60;
/** Where it takes less again, it would not. */
const QUICK_MS = 40;
/** How much the newest picture counts in what drawing takes of late. */
const NEWEST = 0.2;

export interface Listener {
  /** `nextAt` is when it is tried again, this page's clock, ms; null where nothing is to be tried. */
  link(link: Link, nextAt: number | null): void;
  /** `cameAt` is this page's clock, ms, here and below. */
  message(message: ServerMessage, cameAt: number): void;
  /** Resolves when the picture has been drawn. */
  picture(picture: Picture, cameAt: number): Promise<void>;
  map(map: FieldMap): void;
  reading(reading: FrameReading, cameAt: number): void;
}

/** The daemon's usual one: a picture of the same that another viewer has, too, is made once for both. */
const QUALITY = 80;
/** While one zooms and pans, what is seen is asked for so often at most, ms: the picture that there is moves at once. */
const AIM_MS = 80;
/** Readings a second at most: each, for any camera that there is. */
const READINGS_HZ = 120;
/** Pictures a second at most: as quickly as a screen is worth. */
const PICTURES_HZ = 30;

export class Live {
  private socket: WebSocket | null = null;
  private retry: ReturnType<typeof setTimeout> | null = null;
  private retryMs = FIRST_RETRY_MS;
  /** Checks since anything came. */
  private silent = 0;
  private wanted = false;
  /** What drawing a picture has taken of late, ms. */
  private drawingMs = 0;
  private slow = false;
  /** Frames left out: of those asked for before, and of those asked for last, which the daemon counts anew. */
  private leftOut = { before: 0, since: 0 };
  /** Ends when all pictures that came so far have been said to be seen. */
  private said: Promise<void> = Promise.resolve();
  private wish: Wish = {
    readings: false,
    pictures: false,
    overlay: false,
    show: "raw",
  };
  private aim: Aim = COARSE;
  /** Whether the daemon does not send that. */
  private refused = false;
  private askedAt = -Infinity;
  private asking: ReturnType<typeof setTimeout> | null = null;
  /** Whether this connection has been asked for readings. */
  private reads = false;

  constructor(
    private readonly url: string,
    private readonly listener: Listener,
  ) {}

  /** Keeps a connection from now on. */
  open(): void {
    if (this.wanted) return;
    this.wanted = true;
    this.connect();
  }

  /** Keeps none until it is opened again. */
  close(): void {
    this.wanted = false;
    if (this.socket) this.lose(this.socket);
  }

  /** Asks for what is to be seen from now on. */
  want(wish: Wish): void {
    this.wish = wish;
    this.ask();
  }

  /** Has this sent of the raw frame from now on. */
  lookAt(aim: Aim): void {
    if (sameAim(aim, this.aim)) return;
    this.aim = aim;
    this.refused = false;
    const wait = Math.max(0, this.askedAt + AIM_MS - performance.now());
    this.asking ??= setTimeout(() => this.ask(), wait);
  }

  /** Tries at once what would be tried later. */
  now(): void {
    if (!this.wanted || this.socket) return;
    this.retryMs = FIRST_RETRY_MS;
    this.connect();
  }

  start(): void {
    setInterval(() => this.watch(), CHECK_MS);
  }

  private connect(): void {
    if (!this.wanted || this.socket) return;
    if (this.retry !== null) clearTimeout(this.retry);
    this.retry = null;
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.silent = 0;
    this.said = Promise.resolve();
    this.reads = false;
    socket.onopen = () => {
      if (this.socket !== socket) return;
      this.retryMs = FIRST_RETRY_MS;
      this.refused = false;
      this.askClock(socket);
      this.ask();
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      // What one that was given up still has to say is old.
      if (this.socket !== socket) return;
      this.silent = 0;
      const cameAt = pageNow();
      if (typeof event.data === "string") {
        const message = parseMessage(event.data);
        if (message?.type === "tick") this.askClock(socket);
        if (message && !this.isRefusal(message)) this.listener.message(message, cameAt);
      } else {
        void this.show(socket, new Uint8Array(event.data), cameAt);
      }
    };
    socket.onclose = () => this.lose(socket);
  }

  /** Gives a connection up at once: its closing may take a minute where the other side does not answer. */
  private lose(socket: WebSocket): void {
    if (this.socket !== socket) return;
    this.socket = null;
    socket.close();
    this.listener.link("lost", this.wanted ? pageNow() + this.retryMs : null);
    this.retry = setTimeout(() => this.connect(), this.retryMs);
    this.retryMs = Math.min(this.retryMs * 2, LONGEST_RETRY_MS);
  }

  private askClock(socket: WebSocket): void {
    this.send(socket, { type: "clock", asked_ms: pageNow() });
  }

  /** Whether a message says that the part asked for cannot be had: the whole frame is taken in its place. */
  private isRefusal(message: ServerMessage): boolean {
    if (message.type !== "problem" || "reduce" in this.aim) return false;
    const { type, field } = message.problem as Problem & { field?: unknown };
    const many = type === "urn:plenalign:problem:too-many-viewports";
    if (!many && !(typeof field === "string" && field.startsWith("viewport"))) return false;
    this.refused = true;
    this.ask();
    return true;
  }

  private async show(socket: WebSocket, bytes: Uint8Array, cameAt: number): Promise<void> {
    const seen = parseSeen(bytes);
    if (seen?.is === "map") this.listener.map(seen.map);
    if (seen?.is === "reading") this.listener.reading(seen.reading, cameAt);
    if (seen?.is !== "picture") return;
    const { facts } = seen.picture;
    const framesSkipped = this.count(facts.framesSkipped);
    const began = performance.now();
    const before = this.said;
    const drawn = this.listener
      .picture({ ...seen.picture, facts: { ...facts, framesSkipped } }, cameAt)
      // One that could not be drawn is on the way no longer, either.
      .finally(() => this.learn(performance.now() - began));
    // In order: a later one that is drawn first would be taken for this one's sign, too.
    this.said = Promise.allSettled([drawn, before]).then(() =>
      this.send(socket, { type: "seen", seq: facts.seq }),
    );
    await drawn;
  }

  /** Every frame left out so far, where the daemon has counted so many since it was asked last. */
  private count(skipped: number): number {
    const { before, since } = this.leftOut;
    this.leftOut = { before: skipped < since ? before + since : before, since: skipped };
    return this.leftOut.before + skipped;
  }

  private learn(tookMs: number): void {
    this.drawingMs += NEWEST * (tookMs - this.drawingMs);
    const slow = this.drawingMs > (this.slow ? QUICK_MS : SLOW_MS);
    if (slow === this.slow) return;
    this.slow = slow;
    this.ask();
  }

  /** A connection that says nothing is none, whatever TCP thinks. */
  private watch(): void {
    if (!this.socket) return;
    this.silent += 1;
    const allowed = this.socket.readyState === WebSocket.CONNECTING ? CHECKS_CONNECTING : CHECKS;
    if (this.silent >= allowed) this.lose(this.socket);
  }

  private ask(): void {
    if (this.asking !== null) clearTimeout(this.asking);
    this.asking = null;
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    this.askedAt = performance.now();
    const { readings, pictures: on, overlay, show } = this.wish;
    if (readings !== this.reads) {
      this.send(this.socket, { type: "readings", on: readings, max_rate_hz: READINGS_HZ, whole: true });
      this.reads = readings;
    }
    this.send(this.socket, {
      type: "pictures",
      on,
      max_rate_hz: PICTURES_HZ,
      // A view is as large as it is.
      ...EVERY,
      ...(show === "raw" && (this.refused ? instead(this.aim) : this.aim)),
      show,
      quality: QUALITY,
      overlay,
      window: this.slow ? 1 : WINDOW,
    });
  }

  private send(socket: WebSocket, message: ViewerMessage): void {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  }
}
