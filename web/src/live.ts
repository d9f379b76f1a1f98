// The WebSocket's one driver: keeps a connection, reads what comes, asks for pictures while the page is seen.

import { parseMessage, parsePicture, type Picture, type ServerMessage, type ViewerMessage } from "./wire";
import { SILENCE_MS, type Link } from "./state";

const FIRST_RETRY_MS = 500;
const LONGEST_RETRY_MS = 5000;
/** Pictures on the way: one is drawn while the next one travels. */
const WINDOW = 2;

export interface Listener {
  link(link: Link): void;
  message(message: ServerMessage): void;
  /** Resolves when the picture has been drawn. */
  picture(picture: Picture): Promise<void>;
}

export class Live {
  private socket: WebSocket | null = null;
  private retryMs = FIRST_RETRY_MS;
  private heardAt = 0;

  constructor(
    private readonly url: string,
    private readonly listener: Listener,
  ) {}

  start(): void {
    this.connect();
    setInterval(() => this.watch(), 1000);
    document.addEventListener("visibilitychange", () => this.ask());
  }

  private connect(): void {
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heardAt = Date.now();
    socket.onopen = () => {
      this.retryMs = FIRST_RETRY_MS;
      this.ask();
    };
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      this.heardAt = Date.now();
      if (typeof event.data === "string") {
        const message = parseMessage(event.data);
        if (message) this.listener.message(message);
      } else {
        void this.show(socket, new Uint8Array(event.data));
      }
    };
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.socket = null;
      this.listener.link("lost");
      setTimeout(() => this.connect(), this.retryMs);
      this.retryMs = Math.min(this.retryMs * 2, LONGEST_RETRY_MS);
    };
  }

  private async show(socket: WebSocket, bytes: Uint8Array): Promise<void> {
    const picture = parsePicture(bytes);
    if (!picture) return;
    await this.listener.picture(picture);
    this.send(socket, { type: "seen", seq: picture.facts.seq });
  }

  /** A connection that says nothing is none, whatever TCP thinks. */
  private watch(): void {
    if (this.socket && Date.now() - this.heardAt > SILENCE_MS) this.socket.close();
  }

  /** Pictures cost the daemon work: none while nobody looks. */
  private ask(): void {
    if (!this.socket) return;
    const on = document.visibilityState === "visible";
    const reduce = window.innerWidth * window.devicePixelRatio < 700 ? 2 : 1;
    this.send(this.socket, { type: "pictures", on, max_rate_hz: 15, reduce, quality: 80, window: WINDOW });
  }

  private send(socket: WebSocket, message: ViewerMessage): void {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
  }
}
