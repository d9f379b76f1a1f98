// What the browser tests share: the real program on its simulated bench, and a real browser.
//
//   PLENALIGN  the program (default: the debug build, or else the release build)
//   CHROMIUM   the browser (default: /usr/bin/chromium)
//   SHOTS      a folder for screenshots (default: ../target/screenshots)

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { connect, createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";
import { drawn } from "./until.mjs";

const WIDTHS = [360, 1024, 2560];
const HEIGHTS = { 360: 740, 1024: 768, 1280: 800, 2560: 1440 };
const built = ["../target/debug/plenalign", "../target/release/plenalign"];

export const program = process.env.PLENALIGN ?? built.find((path) => existsSync(path));
assert(program, "build the program first: cargo build");

export const shots = process.env.SHOTS ?? "../target/screenshots";
mkdirSync(shots, { recursive: true });

export function step(text) {
  console.log(`- ${text}`);
}

/** A state folder with a configuration in it, gone when the test ends. */
export function folder(config) {
  const state = mkdtempSync(join(tmpdir(), "plenalign-e2e-"));
  const file = join(state, "bench.toml");
  writeFileSync(file, config);
  const env = { ...process.env, PLENALIGN_STATE_DIR: state };
  return { state, file, env, remove: () => rmSync(state, { recursive: true, force: true }) };
}

/** Starts the daemon; `ended` gives its exit code, `address()` where it serves. */
export function start({ file, env }, listen = "127.0.0.1:0", more = ["--simulated"]) {
  const child = spawn(program, ["serve", ...more, "--listen", listen, "--config", file], {
    stdio: ["ignore", "pipe", "inherit"],
    env,
  });
  const begun = { process: child, alive: true };
  begun.ended = new Promise((resolve) => {
    child.once("exit", (code) => {
      begun.alive = false;
      resolve(code);
    });
  });
  begun.address = async () => {
    for await (const line of createInterface({ input: child.stdout })) {
      const found = /http:\/\/\S+/.exec(line);
      if (found) return found[0];
    }
    throw new Error("the daemon ended without saying its address");
  };
  return begun;
}

/** A line to the daemon at `address` over which its WebSocket's words come `ms` late, from the first on. */
export async function lateLine(address, ms) {
  const { hostname, port } = new URL(address);
  const server = createServer((near) => {
    const far = connect(Number(port), hostname);
    let waitMs = 0;
    near.once("data", (bytes) => (waitMs = /upgrade: websocket/i.test(String(bytes)) ? ms : 0));
    near.on("data", (bytes) => far.write(bytes));
    far.on("data", (bytes) => setTimeout(() => near.write(bytes), waitMs));
    for (const [one, other] of [
      [near, far],
      [far, near],
    ]) {
      one.on("close", () => other.destroy());
      one.on("error", () => other.destroy());
    }
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  return { address: `http://127.0.0.1:${server.address().port}/`, close: () => server.close() };
}

export function browse() {
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
  });
}

/** Opens one of the page's pages, as its link does. */
export async function open(page, name) {
  await page.locator("nav a", { hasText: name }).click();
  await page.locator(`main[data-page=${name.toLowerCase()}]`).waitFor();
}

/** Resets the stop on a page, for a reason. */
export async function resetStop(page, why) {
  await page.locator("#reset").click();
  // Thought better of, it is as before: for the keyboard, too.
  await page
    .getByRole("button", { name: "Stay stopped" })
    .and(page.locator("[aria-disabled=false]"))
    .waitFor();
  await page.locator("#why").press("Escape");
  await page.locator("#reset:focus").press("Enter");
  assert(await page.locator("#reset-now").isDisabled(), "a reset is offered without a reason");
  await page.locator("#why").fill(why);
  await page.locator("#reset-now").click();
  await page.locator(".stopped").waitFor({ state: "detached" });
}

/** Frames of the configured camera in a folder, as a camera of files plays them. */
export function render({ file, env }, into, count) {
  mkdirSync(into, { recursive: true });
  for (let number = 0; number < count; number += 1) {
    const out = join(into, `frame-${number}.png`);
    const e = String(30 - 30 * (number / Math.max(1, count - 1)));
    execFileSync(program, ["render", "--config", file, "--out", out, "--e", e], { env, stdio: "ignore" });
  }
}

/** Starts the daemon with a camera that plays so many rendered frames, so many a second; `end()` kills it and takes away what
 *  it leaves. */
export function play(count, rateHz) {
  const place = folder("[bench.simulation]\nrays = 1\n");
  const frames = join(place.state, "frames");
  const bench = folder(`
[bench.camera]
driver = "files"
files = "${frames}"
frame_rate_hz = ${rateHz.toFixed(1)}
`);
  render(place, frames, count);
  const daemon = start(bench);
  daemon.end = () => {
    daemon.process.kill("SIGKILL");
    place.remove();
    bench.remove();
  };
  return daemon;
}

/** What goes wrong in the page itself; what it cannot reach while a daemon is gone is no fault of its. */
export function faults(page) {
  const errors = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  return () => errors.filter((text) => !/ERR_CONNECTION|WebSocket|Failed to load resource/.test(text));
}

const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");

/** What keeps people out who cannot see, or cannot use a mouse, as far as a program can tell. */
export async function accessible(page) {
  await page.evaluate(axe);
  const found = await page.evaluate(async () => {
    const { violations } = await globalThis.axe.run(document, { resultTypes: ["violations"] });
    return violations.map(({ id, impact, nodes }) => ({
      id,
      impact,
      where: nodes.map((node) => node.target[0]),
    }));
  });
  assert.deepEqual(found, [], "not accessible");
}

/** The page made so wide: STOP on the screen, nothing wider than the screen, nothing over anything else, and on a large one
 *  nothing in small print. */
export async function fits(page, width) {
  const height = HEIGHTS[width];
  await page.setViewportSize({ width, height });
  await drawn(page);
  const stop = await page.locator("#stop").boundingBox();
  assert(
    stop && stop.y >= 0 && stop.y + stop.height <= height && stop.x >= 0,
    `STOP is not seen at ${width} px`,
  );
  const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
  assert(wide <= 0, `the page is ${wide} px wider than ${width} px`);
  assert.deepEqual(await page.evaluate(outOfPlace), [], `over something else at ${width} px`);
  if (width === 2560) assert.deepEqual(await page.evaluate(smallPrint), [], `small print at ${width} px`);
}

/** The page at each width, where it [fits](fits). */
export async function photograph(page, name) {
  const before = page.viewportSize();
  for (const width of WIDTHS) {
    await fits(page, width);
    await page.screenshot({ path: `${shots}/${name}-${width}.png`, fullPage: width === 360 });
  }
  await page.setViewportSize(before);
}

/** Tabs over one another, and fields that stick out of what they are in; runs in the page. */
function outOfPlace() {
  const box = (element) => element.getBoundingClientRect();
  const tabs = [...document.querySelectorAll("nav a")];
  const words = (tab) => {
    const range = document.createRange();
    range.selectNodeContents(tab);
    return box(range);
  };
  const colliding = tabs.filter(
    (tab, index) => index > 0 && words(tab).left < words(tabs[index - 1]).right + 3,
  );
  const fields = [...document.querySelectorAll("main :is(input, select, button)")];
  const out = fields.filter((field) => {
    const card = field.closest(".table") ? null : field.closest(".card");
    const label = field.closest("label") ?? card;
    return label && box(field).width > 0 && box(field).right > box(label).right + 1;
  });
  return [...colliding, ...out].map((element) => element.textContent || element.name || element.id);
}

/** Words that nobody reads from further off; runs in the page. */
function smallPrint() {
  const texts = [...document.querySelectorAll("body *")].filter((element) => {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim() !== "");
    return own && element.getClientRects().length > 0 && !element.closest(".unseen");
  });
  // A drawing's letters are as large as the drawing is drawn.
  const letter = (element) =>
    element.closest("svg")
      ? element.getBoundingClientRect().height
      : parseFloat(getComputedStyle(element).fontSize);
  const small = texts.filter((element) => letter(element) < 14);
  return [...new Set(small.map((element) => `${element.tagName}: ${element.textContent}`))];
}

/** The page in the dark, and whether it can be read there. */
export async function darken(page, name) {
  const before = page.viewportSize();
  await page.emulateMedia({ colorScheme: "dark" });
  await page.setViewportSize({ width: 1024, height: 768 });
  await drawn(page);
  await page.screenshot({ path: `${shots}/${name}-dark.png`, fullPage: true });
  await accessible(page);
  await page.emulateMedia({ colorScheme: "light" });
  await page.setViewportSize(before);
}
