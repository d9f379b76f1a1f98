// Zooming and panning: what is seen is asked for at as many pixels as the screen has, shown where it belongs, and where it is
// seen pixel by pixel it is the camera's own.

import assert from "node:assert/strict";
import { browse, faults, play, shots, step } from "./harness.mjs";
import { until } from "./until.mjs";

const daemon = play(1, 15);
const browser = await browse();

try {
  const address = await daemon.address();
  const page = await browser.newPage({ viewport: { width: 1280, height: 1000 } });
  const own = faults(page);
  await page.goto(address);
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 30_000 });
  const worker = page.workers().find((one) => /viewer-worker/.test(one.url()));
  await worker.evaluate(listen);
  const canvas = page.locator("#live");
  const box = await canvas.boundingBox();
  // Near the middle, and within a pixel: two meet in the middle itself.
  const spot = { x: Math.round(box.width / 2) + 7, y: Math.round(box.height / 2) + 5 };
  const levels = await page.evaluate(frame);
  /** The picture that is shown, once it is of what was asked for last and that is as wanted. */
  const shown = (wanted, otherwise) =>
    until(async () => {
      const { part, asked } = await worker.evaluate(() => globalThis.seen);
      const same = part && asked && Object.keys(asked).every((key) => part[key] === asked[key]);
      return same && wanted(part) ? part : null;
    }, otherwise);

  step("the whole frame comes at as many pixels as the screen has");
  // Asked for once the size of the frame is known, which was before anybody listened.
  await canvas.press("+");
  await canvas.press("0");
  const side = Math.min(box.width, box.height);
  const whole = await shown(({ width_px }) => width_px === levels.width, "the whole frame does not come");
  assert.deepEqual([whole.x_px, whole.y_px, whole.height_px], [0, 0, levels.height]);
  assert(Math.abs(whole.picture_width_px - Math.min(side, levels.width)) <= 1, JSON.stringify(whole));

  step("zoomed in, the pixels seen come without loss, and lie where the camera has them");
  await canvas.hover({ position: spot });
  for (let i = 0; i < 6; i += 1) await page.mouse.wheel(0, -250);
  // The frame is 42 times as wide once the last turn of the wheel has been heeded.
  const near = await shown(
    ({ lossless, width_px }) => lossless && width_px < levels.width / 30,
    "no pixels come without loss",
  );
  const held = await probed(page, canvas, spot, levels);
  await page.screenshot({ path: `${shots}/zoom-near.png` });

  step("panned, what was seen goes along at once, and what was not comes");
  const by = { x: 160, y: -90 };
  const { x, y } = await canvas.boundingBox();
  await page.mouse.move(x + spot.x, y + spot.y);
  await page.mouse.down();
  await page.mouse.move(x + spot.x + by.x, y + spot.y + by.y, { steps: 8 });
  await page.mouse.up();
  // On the way there is shown what was asked for on the way.
  const far = Math.floor((by.x * near.width_px) / box.width) - 1;
  const moved = await shown(({ x_px }) => near.x_px - x_px >= far, "nothing comes of dragging");
  assert(Math.abs(moved.width_px - near.width_px) <= 1, JSON.stringify(moved));
  const there = { x: spot.x + by.x, y: spot.y + by.y };
  const along = await probed(page, canvas, there, levels);
  assert.deepEqual([along.x, along.y], [held.x, held.y], "what was under the pointer did not go along");
  await canvas.press("ArrowRight");
  await shown(({ x_px }) => x_px > moved.x_px, "nothing comes of an arrow key");

  step("a double click shows the whole again, and so does the button");
  await canvas.dblclick({ position: spot });
  await shown(({ width_px }) => width_px === levels.width, "the whole frame is not back");
  await page.getByRole("button", { name: "Zoom in" }).click();
  await shown(({ width_px }) => width_px < levels.width, "nothing is zoomed");
  await page.getByRole("button", { name: "Whole" }).click();
  await shown(({ width_px }) => width_px === levels.width, "the whole frame is not back");
  assert.deepEqual(own(), []);
} finally {
  await browser.close();
  daemon.end();
}

/** The pixel under a place of the canvas, which shows the level that the camera has there, and says so. */
async function probed(page, canvas, at, levels) {
  await page.mouse.move(0, 0);
  await canvas.hover({ position: at });
  const text = await until(async () => {
    const said = await page.locator(".probe").innerText({ timeout: 5000 });
    return /grey \d+/.test(said) && said;
  }, "no grey level is said");
  const [, x, y, grey] = /pixel (\d+), (\d+) · grey (\d+)/.exec(text).map(Number);
  assert.equal(grey, levels.of[y * levels.width + x], text);
  const drawn = await canvas.evaluate((element, { x, y }) => {
    const copy = new OffscreenCanvas(element.width, element.height).getContext("2d");
    copy.drawImage(element, 0, 0);
    const ratio = element.width / element.clientWidth;
    return copy.getImageData(Math.floor(x * ratio), Math.floor(y * ratio), 1, 1).data[0];
  }, at);
  assert.equal(drawn, grey, `${text}, and ${drawn} is drawn`);
  return { x, y };
}

/** In the page: the levels of the frame, which is the same each time. */
async function frame() {
  const bitmap = await createImageBitmap(await (await fetch("/api/v1/frame.png")).blob());
  const { width, height } = bitmap;
  const context = new OffscreenCanvas(width, height).getContext("2d");
  context.drawImage(bitmap, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  return { width, height, of: Array.from({ length: width * height }, (_, at) => data[4 * at]) };
}

/** In the worker: what is asked for, and what is shown. */
function listen() {
  globalThis.seen = {};
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (text) {
    const { type, viewport } = JSON.parse(text);
    if (type === "pictures") globalThis.seen.asked = viewport;
    return send.call(this, text);
  };
  const post = globalThis.postMessage;
  globalThis.postMessage = (report) => {
    if (report.is === "picture") globalThis.seen.part = report.facts.part;
    post.call(globalThis, report);
  };
}
