// How quickly the page shows what comes: frames of 1160 x 1160 played thirty times a second, with every overlay drawn.
// What it measures it prints; what it asserts is that age is shown and drops are counted, and that a slow browser gets
// fewer pictures, which become no older the longer it goes on.

import assert from "node:assert/strict";
import { cpus } from "node:os";
import { join } from "node:path";
import { browse, faults, folder, render, start, step } from "./harness.mjs";

const SECONDS = 10;
/** How much slower a slow browser is. */
const SLOWER = 6;
const MOST_BYTES = 200_000;
const PITCH = 29;
const place = folder("[bench.simulation]\nrays = 1\n");
const frames = join(place.state, "frames");
const bench = folder(`
[bench.camera]
driver = "files"
files = "${frames}"
frame_rate_hz = 30.0
`);

render(place, frames, 6);
const daemon = start(bench);
const browser = await browse();

try {
  const address = await daemon.address();
  const context = await browser.newContext({ viewport: { width: 1280, height: 1000 } });
  await context.addInitScript(watch);
  const page = await context.newPage();
  const own = faults(page);
  await page.goto(address);
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 30_000 });

  step("the page comes packed, and small");
  const loaded = await page.evaluate(() =>
    [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
      .filter(({ initiatorType }) => ["navigation", "script", "link", "css"].includes(initiatorType))
      .map(({ name, encodedBodySize, decodedBodySize }) => ({ name, encodedBodySize, decodedBodySize })),
  );
  assert(loaded.length >= 3, JSON.stringify(loaded));
  const bytes = loaded.reduce((sum, { encodedBodySize }) => sum + encodedBodySize, 0);
  assert(
    loaded.every(({ encodedBodySize, decodedBodySize }) => encodedBodySize < decodedBodySize),
    "not packed",
  );
  assert(bytes < MOST_BYTES, `the page is ${bytes} bytes`);
  console.log(`  ${(bytes / 1000).toFixed(0)} kB without the pictures`);

  step("without overlays");
  const plain = await measured(page);

  step("with every overlay");
  for (const name of ["Grid", "Pairs", "Spacing error", "Saturation"]) {
    await page.getByRole("button", { name, exact: true }).click();
  }
  const map = setInterval(() => void page.evaluate(hand, spacingMap()).catch(() => {}), 1000);
  await page.locator(".legend").waitFor();
  const overlaid = await measured(page);

  step("a slow browser gets fewer pictures, counts those left out, and they become no older with time");
  const session = await context.newCDPSession(page);
  await session.send("Emulation.setCPUThrottlingRate", { rate: SLOWER });
  await page.waitForTimeout(2000);
  const slow = await measured(page);
  const later = await measured(page);
  await session.send("Emulation.setCPUThrottlingRate", { rate: 1 });
  clearInterval(map);

  console.log(`on ${cpus().length} × ${cpus()[0]?.model ?? "?"}, browser and daemon together:`);
  for (const [name, one] of Object.entries({
    plain,
    overlaid,
    [`overlaid, ${SLOWER}× slower`]: slow,
    "later on": later,
  })) {
    console.log(
      `  ${name}: ${one.rate.toFixed(1)} pictures/s, age ${one.age.median} ms (95 %: ${one.age.most} ms), ` +
        `main thread blocked ${one.blocked.median} ms (95 %: ${one.blocked.most} ms, longest ${one.blocked.longest} ms, ` +
        `${one.tasks} over 50 ms), ${one.skipped} frames left out`,
    );
  }
  for (const one of [plain, overlaid, slow]) {
    assert(one.age.count > 10, "no age is shown");
    assert(one.rate > 1, "hardly any picture is shown");
  }
  assert(slow.rate < overlaid.rate, "a slow browser does not get fewer pictures");
  assert(slow.skipped > 0, "frames left out are not counted");
  // Nothing piles up: however long it goes on, pictures become no older.
  assert(
    later.age.median < 2 * slow.age.median + 500,
    `pictures become older: ${slow.age.median} ms at first, ${later.age.median} ms later`,
  );
  assert.deepEqual(own(), []);
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  place.remove();
  bench.remove();
}

/** What the page shows and how its main thread fares, for a while. */
async function measured(page) {
  const skippedBefore = await skipped(page);
  await page.evaluate(() => globalThis.seen.begin());
  await page.waitForTimeout(SECONDS * 1000);
  const { ages, gaps, tasks, pictures } = await page.evaluate(() => globalThis.seen.end());
  const sorted = (values) => [...values].sort((one, other) => one - other);
  const part = (values, share) => Math.round(sorted(values)[Math.floor(share * (values.length - 1))] ?? NaN);
  return {
    rate: pictures / SECONDS,
    age: { count: ages.length, median: part(ages, 0.5), most: part(ages, 0.95) },
    blocked: { median: part(gaps, 0.5), most: part(gaps, 0.95), longest: part(gaps, 1) },
    tasks,
    skipped: (await skipped(page)) - skippedBefore,
  };
}

async function skipped(page) {
  const facts = await page.locator(".picture p.facts").first().innerText();
  return Number(/(\d+) not shown/.exec(facts)?.[1] ?? 0);
}

/** In the page, before anything else: ages as they are shown, tasks of the main thread, and pictures as they come. */
function watch() {
  const seen = { on: false, ages: [], gaps: [], tasks: 0, pictures: 0 };
  globalThis.seen = {
    begin: () => Object.assign(seen, { on: true, ages: [], gaps: [], tasks: 0, pictures: 0 }),
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
    const shown = / (\d+) ms old/.exec(document.querySelector(".picture p.facts")?.textContent ?? "");
    if (seen.on && shown) seen.ages.push(Number(shown[1]));
  }, 97);
  const draw = CanvasRenderingContext2D.prototype.drawImage;
  CanvasRenderingContext2D.prototype.drawImage = function (image, ...rest) {
    if (seen.on && image instanceof ImageBitmap && this.canvas?.id === "live") seen.pictures += 1;
    return draw.call(this, image, ...rest);
  };
  globalThis.WebSocket = class extends WebSocket {
    constructor(...how) {
      super(...how);
      globalThis.socket = this;
    }
  };
}

/** In the page: a binary message as if from the daemon, which measures no frames of old. */
function hand(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  globalThis.socket.onmessage?.(new MessageEvent("message", { data: bytes.buffer }));
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
