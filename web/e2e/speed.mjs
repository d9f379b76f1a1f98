// How quickly the page shows what comes: frames of 1160 x 1160 played thirty times a second, with every overlay drawn.
// What it measures it prints; what it asserts holds on a machine that has other things to do: age is shown and drops are
// counted, and a slow browser gets fewer pictures, which become no older the longer it goes on.

import assert from "node:assert/strict";
import { cpus } from "node:os";
import { browse, faults, play, step } from "./harness.mjs";

/** How long figures are taken for, s: enough for what is asserted. `SECONDS=10` for figures that one quotes. */
const SECONDS = Number(process.env.SECONDS ?? 3);
/** How long a slow browser is watched, s: what piles up in it shows only after a while. */
const SLOW_SECONDS = 10;
/** How much slower the main thread of a slow browser is. */
const SLOWER = 6;
/** What a slow browser needs for a picture, ms: its worker is not slowed with its main thread. */
const SLOW_MS = 150;
/** Pictures on the way to a browser at most. */
const WINDOW = 2;
/** Fewer than these say nothing: a machine that is slow itself is waited for. */
const LEAST = 5;
const MOST_BYTES = 200_000;
const PITCH = 29;
const daemon = play(6, 30);
const browser = await browse();

try {
  const address = await daemon.address();
  const context = await browser.newContext({ viewport: { width: 1280, height: 1000 } });
  await context.addInitScript(watch);
  const page = await context.newPage();
  const own = faults(page);
  await page.goto(address);
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 30_000 });
  const drawing = page.workers().find((worker) => /viewer-worker/.test(worker.url()));
  assert(drawing, "no worker draws the picture");
  await drawing.evaluate(watchDrawing);

  step("the page comes packed, and small");
  const loaded = await page.evaluate(() =>
    [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
      .filter(({ name, initiatorType }) => initiatorType === "navigation" || /\.(js|css)$/.test(name))
      .map(({ name, encodedBodySize, decodedBodySize }) => ({ name, encodedBodySize, decodedBodySize })),
  );
  for (const part of [/\/index-[\w-]{8}\.js$/, /\/index-[\w-]{8}\.css$/, /\/viewer-worker-[\w-]{8}\.js$/]) {
    assert(
      loaded.some(({ name }) => part.test(name)),
      `${part} is not among ${JSON.stringify(loaded)}`,
    );
  }
  const bytes = loaded.reduce((sum, { encodedBodySize }) => sum + encodedBodySize, 0);
  assert(
    loaded.every(({ encodedBodySize, decodedBodySize }) => encodedBodySize < decodedBodySize),
    "not packed",
  );
  assert(bytes < MOST_BYTES, `the page is ${bytes} bytes`);
  console.log(`  ${(bytes / 1000).toFixed(0)} kB without the pictures`);

  step("without overlays");
  const plain = await measured(page, drawing);

  step("with every overlay");
  for (const name of ["Grid", "Pairs", "Spacing error", "Saturation"]) {
    await page.getByRole("button", { name, exact: true }).click();
  }
  const map = setInterval(() => void drawing.evaluate(hand, spacingMap()).catch(() => {}), 1000);
  await page.locator(".legend").waitFor();
  const overlaid = await measured(page, drawing);

  step("a slow main thread does not delay pictures; it gets its own time");
  const session = await context.newCDPSession(page);
  await session.send("Emulation.setCPUThrottlingRate", { rate: SLOWER });
  await page.waitForTimeout(2000);
  const throttled = await measured(page, drawing);

  step("a slow browser gets fewer pictures, counts those left out, and they become no older with time");
  await drawing.evaluate((ms) => (globalThis.drawn.spin = ms), SLOW_MS);
  await page.waitForTimeout(2000);
  const slow = await measured(page, drawing, SLOW_SECONDS);
  const later = await measured(page, drawing, SLOW_SECONDS);
  await session.send("Emulation.setCPUThrottlingRate", { rate: 1 });
  clearInterval(map);

  console.log(`on ${cpus().length} × ${cpus()[0]?.model ?? "?"}, browser and daemon together:`);
  const all = {
    plain,
    overlaid,
    [`overlaid, main thread ${SLOWER}× slower`]: throttled,
    [`and ${SLOW_MS} ms more for a picture`]: slow,
    "later on": later,
  };
  for (const [name, one] of Object.entries(all)) {
    console.log(
      `  ${name}: ${one.rate.toFixed(1)} pictures/s; age ${one.sent.median} ms when sent, ${one.drawn.median} ms when ` +
        `drawn (95 %: ${one.drawn.most} ms), ${one.shown.median} ms as shown (95 %: ${one.shown.most} ms); main thread ` +
        `blocked ${one.blocked.median} ms (95 %: ${one.blocked.most} ms, longest ${one.blocked.longest} ms, ` +
        `${one.tasks} tasks over 50 ms); ${one.skipped} frames left out`,
    );
  }
  for (const [name, one] of Object.entries(all)) {
    assert(one.shown.count > 0, `no age is shown: ${name}`);
    assert(
      one.unseen <= WINDOW,
      `${one.unseen} pictures are on the way to who has not seen the last: ${name}`,
    );
  }
  for (const one of [slow, later]) {
    assert(one.rate <= 1000 / SLOW_MS, "a slow browser does not get fewer pictures");
    assert(one.skipped > 0, "frames left out are not counted");
  }
  // Nothing piles up: however long it goes on, pictures become no older.
  for (const age of ["drawn", "shown"]) {
    assert(
      later[age].median < 2 * slow[age].median + 500,
      `pictures become older: ${slow[age].median} ms at first, ${later[age].median} ms later, ${age}`,
    );
  }
  assert.deepEqual(own(), []);
} finally {
  await browser.close();
  daemon.end();
}

/** What the page shows and how its threads fare, for so many seconds. */
async function measured(page, drawing, seconds = SECONDS) {
  const skippedBefore = await skipped(page);
  const began = Date.now();
  await drawing.evaluate(() => globalThis.drawn.begin());
  await page.evaluate(() => globalThis.seen.begin());
  await page.waitForTimeout(seconds * 1000);
  while ((await drawing.evaluate(() => globalThis.drawn.pictures.length)) < LEAST)
    await page.waitForTimeout(100);
  const { pictures, unseen } = await drawing.evaluate(() => globalThis.drawn.end());
  const { ages, gaps, tasks } = await page.evaluate(() => globalThis.seen.end());
  const took = (Date.now() - began) / 1000;
  const part = (values, share) => {
    const sorted = [...values].sort((one, other) => one - other);
    return Math.round(sorted[Math.floor(share * (values.length - 1))] ?? NaN);
  };
  const age = (values) => ({ count: values.length, median: part(values, 0.5), most: part(values, 0.95) });
  return {
    rate: pictures.length / took,
    sent: age(pictures.map(({ sent }) => sent)),
    drawn: age(pictures.map(({ drawn }) => drawn)),
    shown: age(ages),
    blocked: { median: part(gaps, 0.5), most: part(gaps, 0.95), longest: part(gaps, 1) },
    tasks,
    unseen,
    skipped: (await skipped(page)) - skippedBefore,
  };
}

async function skipped(page) {
  const facts = await page.locator(".picture p.facts").first().innerText();
  return Number(/(\d+) not shown/.exec(facts)?.[1] ?? 0);
}

/** In the page, before anything else: ages as they are shown, and tasks of the main thread. */
function watch() {
  const seen = { on: false, ages: [], gaps: [], tasks: 0 };
  globalThis.seen = {
    begin: () => Object.assign(seen, { on: true, ages: [], gaps: [], tasks: 0 }),
    end: () => ((seen.on = false), seen),
  };
  new PerformanceObserver((list) => {
    if (seen.on) seen.tasks += list.getEntries().length;
  }).observe({ type: "longtask" });
  // A message to oneself comes when the main thread is free: how late it comes is how long something else kept it.
  const channel = new MessageChannel();
  let sent = performance.now();
  channel.port1.onmessage = () => {
    if (seen.on) seen.gaps.push(performance.now() - sent);
    setTimeout(() => {
      sent = performance.now();
      channel.port2.postMessage(null);
    }, 5);
  };
  channel.port2.postMessage(null);
  setInterval(() => {
    const shown = /played (\d+) ms ago/.exec(document.querySelector(".picture p.facts")?.textContent ?? "");
    if (seen.on && shown) seen.ages.push(Number(shown[1]));
  }, 97);
}

/** In the worker: how old pictures are when they are drawn, with `spin` ms more of work for each; how many are on the way
 *  at once, at most; and the connection. */
function watchDrawing() {
  const drawn = { spin: 0, pictures: [], here: 0, unseen: 0 };
  drawn.begin = () => Object.assign(drawn, { pictures: [], unseen: 0 });
  drawn.end = () => ({ pictures: drawn.pictures, unseen: drawn.unseen });
  globalThis.drawn = drawn;
  const post = globalThis.postMessage;
  globalThis.postMessage = (report) => {
    if (report.is === "picture") {
      const { ageMs } = report.facts;
      drawn.pictures.push({ sent: ageMs, drawn: ageMs + Date.now() - report.sentAt });
    }
    post.call(globalThis, report);
  };
  const decode = globalThis.createImageBitmap;
  globalThis.createImageBitmap = (...what) => {
    drawn.here += 1;
    drawn.unseen = Math.max(drawn.unseen, drawn.here);
    const until = performance.now() + drawn.spin;
    while (performance.now() < until);
    return decode(...what);
  };
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (text) {
    globalThis.socket = this;
    if (JSON.parse(text).type === "seen") drawn.here = Math.max(0, drawn.here - 1);
    return send.call(this, text);
  };
}

/** In the worker: a binary message as if from the daemon, which measures no frames of old. */
function hand(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  globalThis.socket?.onmessage?.(new MessageEvent("message", { data: bytes.buffer }));
}

/** A Viewed with a SpacingMap of every micro-image of the frame, by the wire format of `frame.proto`. */
function spacingMap() {
  const side = Math.floor(1160 / PITCH);
  const count = side * side;
  const floats = (of) => {
    const bytes = Buffer.alloc(4 * count);
    for (let at = 0; at < count; at += 1) bytes.writeFloatLE(of(at % side, Math.floor(at / side)), 4 * at);
    return bytes;
  };
  const varint = (value) => {
    const bytes = [];
    for (; value > 127; value = Math.floor(value / 128)) bytes.push((value % 128) + 128);
    return Buffer.from([...bytes, value]);
  };
  const field = (number, bytes) => Buffer.concat([varint(8 * number + 2), varint(bytes.length), bytes]);
  const double = (number, value) => {
    const bytes = Buffer.alloc(9);
    bytes[0] = 8 * number + 1;
    bytes.writeDoubleLE(value, 1);
    return bytes;
  };
  const map = Buffer.concat([
    double(2, PITCH),
    double(3, 19.725),
    field(
      4,
      floats((x) => (x + 0.5) * PITCH),
    ),
    field(
      5,
      floats((_, y) => (y + 0.5) * PITCH),
    ),
    field(
      6,
      floats((x, y) => 19.725 + 0.002 * (x - y)),
    ),
    field(
      7,
      floats(() => 0.01),
    ),
    field(8, Buffer.alloc(count, 1)),
  ]);
  return field(2, map).toString("base64");
}
