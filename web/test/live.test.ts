import { create, toBinary } from "@bufbuild/protobuf";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { FrameSchema, ReadingSchema, ReadingState, ViewedSchema } from "../src/gen/plenalign/v1/frame_pb";
import { Live } from "../src/daemon/live";
import { pageNow } from "../src/browser/page-clock";
import type { FrameReading, Part, PictureFacts } from "../src/daemon/wire";
import type { Wish } from "../src/daemon/wish";

const TICK = JSON.stringify({
  type: "tick",
  seq: 1,
  boot_id: "b",
  now: "2026-01-01T00:00:00Z",
  monotonic_us: 7,
});

class Socket {
  static readonly CONNECTING = 0;
  static readonly OPEN = 1;
  static newest: Socket;
  readyState = Socket.OPEN;
  binaryType = "";
  sent: { type: string; seq?: number; window?: number; reduce?: number; viewport?: Part }[] = [];
  onopen: (() => void) | null = null;
  onclose: (() => void) | null = null;
  static made = 0;
  onmessage: ((event: { data: ArrayBuffer | string }) => void) | null = null;
  constructor() {
    Socket.newest = this;
    Socket.made += 1;
  }
  send(text: string): void {
    this.sent.push(JSON.parse(text) as Socket["sent"][number]);
  }
  close(): void {
    // The browser says so later.
  }
  reading(): void {
    const value = create(ReadingSchema, { state: ReadingState.LOST, why: "gone" });
    const bytes = toBinary(ViewedSchema, create(ViewedSchema, { what: { case: "reading", value } }));
    this.onmessage?.({ data: new Uint8Array(bytes).buffer });
  }
  picture(seq: number, framesSkipped = 0): void {
    const value = create(FrameSchema, {
      seq: BigInt(seq),
      framesSkipped: BigInt(framesSkipped),
      jpeg: new Uint8Array([1]),
    });
    const bytes = toBinary(ViewedSchema, create(ViewedSchema, { what: { case: "frame", value } }));
    this.onmessage?.({ data: new Uint8Array(bytes).buffer });
  }
}

const wish: Wish = {
  readings: true,
  pictures: true,
  overlay: false,
  show: "raw",
};

const part: Part = {
  x_px: 0,
  y_px: 0,
  width_px: 1000,
  height_px: 800,
  picture_width_px: 400,
  picture_height_px: 320,
  lossless: false,
};

describe("the live connection", () => {
  let drawn: PictureFacts[] = [];
  let read: FrameReading[] = [];
  let draw: () => Promise<void>;
  let live: Live;
  let links: [string, number | null][] = [];
  let heard: string[] = [];
  const socket = () => Socket.newest;
  const sent = (type: string) => socket().sent.filter((message) => message.type === type);

  beforeEach(() => {
    vi.useFakeTimers();
    vi.stubGlobal("WebSocket", Socket);
    drawn = [];
    read = [];
    draw = () => Promise.resolve();
    links = [];
    heard = [];
    live = new Live("ws://bench", {
      link: (link, nextAt) => void links.push([link, nextAt === null ? null : nextAt - pageNow()]),
      message: (message) => void heard.push(message.type),
      map: () => undefined,
      reading: (reading) => void read.push(reading),
      picture: ({ facts }) => {
        drawn.push(facts);
        return draw();
      },
    });
    live.want(wish);
    live.start();
    live.open();
    socket().onopen?.();
  });
  afterEach(async () => {
    // What is said of the last picture is said before the connection's class is gone.
    await vi.advanceTimersByTimeAsync(0);
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  it("says that a picture was seen once it is drawn, and no sooner", async () => {
    draw = () => new Promise((resolve) => setTimeout(resolve, 30));
    socket().picture(7);
    await vi.advanceTimersByTimeAsync(29);
    expect(sent("seen")).toEqual([]);
    await vi.advanceTimersByTimeAsync(1);
    expect(sent("seen")).toEqual([{ type: "seen", seq: 7 }]);
  });

  it("asks for readings once, and for no more of them where nobody looks; a new connection is asked anew", () => {
    const on = { type: "readings", on: true, max_rate_hz: 120, whole: true };
    expect(sent("readings")).toEqual([on]);
    live.want({ ...wish, overlay: true });
    expect(sent("readings")).toEqual([on]);
    live.want({ ...wish, readings: false });
    live.want(wish);
    expect(sent("readings")).toEqual([on, { ...on, on: false }, on]);
    socket().onclose?.();
    live.now();
    socket().onopen?.();
    expect(sent("readings")).toEqual([on]);
  });

  it("asks for the daemon's clock at once, and with each tick", () => {
    expect(sent("clock").length).toBe(1);
    socket().onmessage?.({ data: TICK });
    expect(sent("clock").at(-1)).toEqual({ type: "clock", asked_ms: pageNow() });
    const clock = {
      type: "clock",
      seq: 1,
      boot_id: "b",
      asked_ms: pageNow(),
      now: "2026-01-01T00:00:00Z",
      monotonic_us: 7,
    };
    socket().onmessage?.({ data: JSON.stringify(clock) });
    expect(heard).toEqual(["tick", "clock"]);
    expect(sent("clock").length).toBe(2);
  });

  it("hands a reading on, of which nothing is said to have been seen", async () => {
    socket().reading();
    await vi.advanceTimersByTimeAsync(0);
    expect(read.map(({ found }) => found)).toEqual([{ is: "lost", why: "gone" }]);
    expect(sent("seen")).toEqual([]);
  });

  it("says so in the order in which pictures came, whichever is drawn first", async () => {
    const times = [30, 10];
    draw = () => new Promise((resolve) => setTimeout(resolve, times.shift()));
    socket().picture(7);
    socket().picture(8);
    await vi.advanceTimersByTimeAsync(29);
    expect(sent("seen")).toEqual([]);
    await vi.advanceTimersByTimeAsync(1);
    expect(sent("seen").map(({ seq }) => seq)).toEqual([7, 8]);
  });

  it("has fewer pictures on the way where drawing is slow, until it is quick again", async () => {
    expect(sent("pictures").map(({ window }) => window)).toEqual([2]);
    const after = async (ms: number) => {
      draw = () => new Promise((resolve) => setTimeout(resolve, ms));
      for (let seq = 0; seq < 20; seq += 1) {
        socket().picture(seq);
        await vi.advanceTimersByTimeAsync(ms);
      }
      return sent("pictures").map(({ window }) => window);
    };
    expect(await after(90)).toEqual([2, 1]);
    // Between the two it stays as it is.
    expect(await after(50)).toEqual([2, 1]);
    expect(await after(10)).toEqual([2, 1, 2]);
  });

  it("asks for what is seen, and not for everything that is passed on the way there", () => {
    const at = (x_px: number): Part => ({ ...part, x_px });
    for (let x = 0; x < 10; x += 1) live.lookAt({ viewport: at(x) });
    vi.advanceTimersByTime(79);
    expect(sent("pictures").map(({ reduce }) => reduce)).toEqual([4]);
    vi.advanceTimersByTime(1);
    live.lookAt({ viewport: at(9) });
    vi.advanceTimersByTime(1000);
    expect(sent("pictures").map(({ viewport }) => viewport?.x_px)).toEqual([undefined, 9]);
    // A view has a size of its own.
    live.want({ ...wish, show: "depth" });
    const last = sent("pictures").at(-1);
    expect([last?.reduce, last?.viewport]).toEqual([1, undefined]);
  });

  it("takes the whole frame, as fine, where it is refused a part, and tries the next part", () => {
    const problem = (type: string, field?: string) =>
      socket().onmessage?.({
        data: JSON.stringify({ type: "problem", seq: 1, boot_id: "b", problem: { type, field } }),
      });
    live.lookAt({ viewport: part });
    vi.advanceTimersByTime(100);
    problem("urn:plenalign:problem:too-many-viewports");
    live.lookAt({ viewport: { ...part, x_px: 1 } });
    vi.advanceTimersByTime(100);
    problem("urn:plenalign:problem:invalid", "viewport");
    expect(sent("pictures").map(({ reduce, viewport }) => viewport?.x_px ?? reduce)).toEqual([4, 0, 2, 1, 2]);
    expect(heard).toEqual([]);
    problem("urn:plenalign:problem:invalid", "quality");
    expect(heard).toEqual(["problem"]);
  });

  it("says when it tries again, ever later, and tries at once when it is asked to", () => {
    const made = Socket.made;
    socket().onclose?.();
    expect(links).toEqual([["lost", 500]]);
    vi.advanceTimersByTime(499);
    expect(Socket.made).toBe(made);
    vi.advanceTimersByTime(1);
    expect(Socket.made).toBe(made + 1);
    socket().onclose?.();
    expect(links[1]).toEqual(["lost", 1000]);
    live.now();
    expect(Socket.made).toBe(made + 2);
    // What was to come later does not come besides, and nothing comes of asking twice.
    live.now();
    vi.advanceTimersByTime(3000);
    expect(Socket.made).toBe(made + 2);
    // Asked to, it begins anew.
    socket().onclose?.();
    expect(links[2]).toEqual(["lost", 500]);
  });

  it("is lost after less than 3 s of silence, whatever becomes of its closing, and is deaf to what comes of it then", () => {
    const old = socket();
    for (let second = 0; second < 10; second += 1) {
      vi.advanceTimersByTime(1000);
      old.onmessage?.({ data: TICK });
    }
    expect(links).toEqual([]);
    vi.advanceTimersByTime(2400);
    expect(links).toEqual([]);
    vi.advanceTimersByTime(599);
    expect(links.map(([link]) => link)).toEqual(["lost"]);
    const before = heard.length;
    old.onmessage?.({ data: TICK });
    old.onclose?.();
    expect(heard.length).toBe(before);
    expect(links.length).toBe(1);
  });

  it("waits a little longer for a connection to be made, and then tries anew", () => {
    socket().onclose?.();
    vi.advanceTimersByTime(500);
    const made = Socket.made;
    socket().readyState = Socket.CONNECTING;
    vi.advanceTimersByTime(4500);
    expect(Socket.made).toBe(made);
    vi.advanceTimersByTime(1600);
    expect(Socket.made).toBe(made + 1);
  });

  it("tries nothing again when it was closed on purpose", () => {
    live.close();
    socket().onclose?.();
    expect(links).toEqual([["lost", null]]);
    const made = Socket.made;
    live.now();
    vi.advanceTimersByTime(60_000);
    expect(Socket.made).toBe(made);
  });

  it("counts frames left out on, where the daemon begins anew", () => {
    for (const [seq, skipped] of [
      [1, 0],
      [5, 3],
      [9, 6],
      [10, 0],
      [14, 3],
    ] as const) {
      socket().picture(seq, skipped);
    }
    expect(drawn.map(({ framesSkipped }) => framesSkipped)).toEqual([0, 3, 6, 6, 9]);
  });
});
