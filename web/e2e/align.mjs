// End to end: the real program on its simulated bench, driven through the page in a real browser.
//
//   PLENALIGN  the program (default: the debug build, or else the release build)
//   CHROMIUM   the browser (default: /usr/bin/chromium)
//   SHOTS      a folder for screenshots (default: test-results)

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const ALIGNMENT_MS = 240_000;
const WIDTHS = [360, 1024, 1920];
const OVER = ".outcome.converged, .outcome.not_converged, .outcome.failed, .outcome.cancelled";
// A small sensor, so that it is quick; the operator is this script.
const CONFIG = `
[sensor]
width_px = 560
height_px = 560

[bench.simulation]
rays = 16
preview_rays = 1
preview_rate_hz = 5.0
operator_confirms = false
`;

const built = ["../target/debug/plenalign", "../target/release/plenalign"];
const program = process.env.PLENALIGN ?? built.find((path) => existsSync(path));
assert(program, "build the program first: cargo build");
const shots = process.env.SHOTS ?? "test-results";
mkdirSync(shots, { recursive: true });
const state = mkdtempSync(join(tmpdir(), "plenalign-e2e-"));
const config = join(state, "bench.toml");
writeFileSync(config, CONFIG);

const started = Date.now();
let daemon = start("127.0.0.1:0");
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
});

try {
  const address = await firstAddress();
  const page = await browser.newPage({ viewport: { width: 1024, height: 900 } });
  const errors = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (message) => message.type() === "error" && errors.push(message.text()));
  await page.goto(address);

  step("the simulated bench says so");
  await page.locator(".simulated").waitFor();
  assert.match(await page.title(), /SIMULATED/);

  step("a live picture comes");
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  await photograph(page, "idle");

  step("STOP latches, refuses a start, and is reset");
  await page.locator("#stop").click();
  await page.locator("#reset").waitFor();
  assert(await page.locator("#start").isDisabled());
  await page.locator("#reset").click();
  await page.locator("#reset").waitFor({ state: "detached" });

  step("STOP in mid-run ends the job and stops the axes");
  await page.locator("#start").click();
  await page.locator(".axes .tag", { hasText: "moving" }).first().waitFor({ timeout: 20_000 });
  await page.locator("#stop").click();
  await page.locator(".outcome.cancelled").waitFor({ timeout: 15_000 });
  await page
    .locator(".axes .tag", { hasText: "moving" })
    .first()
    .waitFor({ state: "detached", timeout: 15_000 });
  await photograph(page, "stopped");
  await page.locator("#reset").click();
  await page.locator("#reset").waitFor({ state: "detached" });

  step("an alignment runs to its end, through a reload");
  await page.locator("#start").click();
  await page.locator("#cancel").waitFor();
  const rows = await seeThrough(page);
  const ended = await page.locator(".job").innerText();
  assert.equal(await page.locator(".outcome").textContent(), "Converged", ended);
  assert(rows >= 4, `only ${rows} iterations are shown`);
  await page.locator(".result").waitFor();
  assert.doesNotMatch(await page.locator("body").innerText(), /NaN|undefined|null\b|Infinity/);
  await page.locator(".spacing .tag.good").waitFor({ timeout: 10_000 });
  await photograph(page, "converged");

  step("a reload shows the same result");
  await page.reload();
  await page.locator(".outcome.converged").waitFor({ timeout: 10_000 });
  assert.equal(await page.locator(".iterations tbody tr").count(), rows);
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 10_000 });
  assert((await spread(page)) > 10, "the picture is blank");

  step("a daemon that is killed is seen to be gone");
  daemon.process.kill("SIGKILL");
  await page.locator(".link[data-link=lost]").waitFor({ timeout: 10_000 });
  assert.equal(await page.locator(".picture").getAttribute("data-state"), "stale");
  await photograph(page, "lost");

  step("and is seen to be back, with nothing of the old run left");
  await daemon.ended;
  daemon = start(new URL(address).host);
  await page.locator(".link").waitFor({ state: "detached", timeout: 20_000 });
  await page.locator(".job[data-state=none]").waitFor({ timeout: 10_000 });
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  daemon.process.kill("SIGTERM");
  assert.equal(await daemon.ended, 0, "the daemon's exit code after SIGTERM");

  // The browser reports what it cannot reach; nothing else may be wrong.
  const own = errors.filter((text) => !/ERR_CONNECTION|WebSocket|Failed to load resource/.test(text));
  assert.deepEqual(own, []);
  const seconds = ((Date.now() - started) / 1000).toFixed(0);
  console.log(`end to end: converged in ${rows} iterations, ${seconds} s, screenshots in ${shots}/`);
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  rmSync(state, { recursive: true, force: true });
}

/** Starts the daemon; `ended` gives its exit code. */
function start(listen) {
  const child = spawn(program, ["serve", "--simulated", "--listen", listen, "--config", config], {
    stdio: ["ignore", "pipe", "inherit"],
    env: { ...process.env, PLENALIGN_STATE_DIR: state },
  });
  const begun = { process: child, alive: true };
  begun.ended = new Promise((resolve) => {
    child.once("exit", (code) => {
      begun.alive = false;
      resolve(code);
    });
  });
  return begun;
}

/** Confirms what the job asks for until the job is over; returns how many iterations are shown. */
async function seeThrough(page) {
  const until = Date.now() + ALIGNMENT_MS;
  let photographed = false;
  let asked = 0;
  while (!(await page.locator(OVER).isVisible())) {
    if (Date.now() > until) {
      const shown = await page.locator(".job").innerText();
      throw new Error(`the alignment did not end in time; the page shows: ${shown}`);
    }
    assert(daemon.alive, "the daemon ended");
    const confirm = page.locator("#confirm");
    if (await confirm.isVisible()) {
      if (asked++ === 0) await photograph(page, "operator");
      const heading = await page.locator(".operator h3").textContent();
      await confirm.click();
      await page
        .locator(".operator h3", { hasText: heading })
        .waitFor({ state: "detached", timeout: 15_000 });
    }
    if (!photographed && (await page.locator(".iterations tbody tr").count()) >= 3) {
      photographed = true;
      await photograph(page, "running");
      await page.reload();
      await page.locator(".outcome").waitFor({ timeout: 10_000 });
      assert((await page.locator(".iterations tbody tr").count()) >= 3, "a reload loses iterations");
    }
    await page.waitForTimeout(100);
  }
  assert(asked >= 3, `the operator was asked ${asked} times`);
  return page.locator(".iterations tbody tr").count();
}

function step(text) {
  console.log(`- ${text}`);
}

/** The address the daemon prints. */
async function firstAddress() {
  for await (const line of createInterface({ input: daemon.process.stdout })) {
    const found = /http:\/\/\S+/.exec(line);
    if (found) return found[0];
  }
  throw new Error("the daemon ended without saying its address");
}

/** Standard deviation of the canvas's grey levels. */
function spread(page) {
  return page.evaluate(() => {
    const canvas = document.querySelector("canvas#live");
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let [n, sum, squares] = [0, 0, 0];
    for (let i = 0; i < data.length; i += 4) {
      n += 1;
      sum += data[i];
      squares += data[i] * data[i];
    }
    return Math.sqrt(squares / n - (sum / n) ** 2);
  });
}

/** The page at each width: STOP on the screen, nothing wider than the screen. */
async function photograph(page, name) {
  for (const width of WIDTHS) {
    await page.setViewportSize({ width, height: width === 360 ? 740 : 1000 });
    await page.waitForTimeout(400);
    const stop = await page.locator("#stop").boundingBox();
    const height = page.viewportSize().height;
    assert(
      stop && stop.y >= 0 && stop.y + stop.height <= height && stop.x >= 0,
      `STOP is not seen at ${width} px`,
    );
    const wide = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
    assert(wide <= 0, `the page is ${wide} px wider than ${width} px`);
    await page.screenshot({ path: `${shots}/${name}-${width}.png`, fullPage: width === 360 });
  }
  await page.setViewportSize({ width: 1024, height: 900 });
}
