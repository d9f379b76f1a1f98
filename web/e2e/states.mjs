// States that people meet, on a bench of its own processes: a stage controller's twin behind a terminal and a camera that
// plays files. First start, replay, camera unplugged and back, stage gone and back,
// an axis on its limit switch, devices found.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { open as openFile } from "node:fs/promises";
import { renameSync, rmSync } from "node:fs";
import { join } from "node:path";
import {
  accessible,
  browse,
  darken,
  faults,
  folder,
  open,
  photograph,
  program,
  render,
  shots,
  start,
  step,
} from "./harness.mjs";
import { drawn } from "./until.mjs";

const camera = `
[sensor]
pixel_um = 3.45
width_px = 320
height_px = 320

[bench.simulation]
rays = 1
`;
const place = folder(camera);
const frames = join(place.state, "frames");
const link = join(place.state, "stage");
// What a bench of hardware has to say of its camera.
const optics = `
[main_lens]
focal_length_mm = 20.0

[mla]
array = "square"
pitch_mm = 0.1
focal_length_mm = 0.5
angular_resolution = 3.13
mode = "galilean"

[shell]
outer_radius_mm = 59.0
inner_radius_mm = 51.0
refractive_index = 1.49
`;
const bench = folder(`
${camera}
${optics}
[bench]
driver = "hardware"

[bench.controllers.main]
driver = "grbl"
port = "${link}"

[bench.camera]
driver = "files"
files = "${frames}"
frame_rate_hz = 5.0
timeout_ms = 1000
`);

render(place, frames, 3);
let stage = await plugIn();
const daemon = start(bench, "127.0.0.1:0", []);
const browser = await browse();

try {
  const address = await daemon.address();
  const page = await browser.newPage({ viewport: { width: 1024, height: 900 } });
  const own = faults(page);

  step("of a bench that is not heard of yet nothing is said");
  let letGo;
  const held = new Promise((resolve) => (letGo = resolve));
  await page.route(/viewer-worker/, async (route) => {
    await held;
    await route.continue();
  });
  for (const name of ["alignment", "live", "meter"]) {
    await page.goto(`${address}#/${name}`);
    await page.locator(`main[data-page=${name}]`).waitFor();
    await drawn(page);
    const said = await page.locator("main").innerText();
    assert.doesNotMatch(said, /No job has been run|Nothing measured|begins with one/, name);
  }
  letGo();
  await page.goto(`${address}#/alignment/0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11`);
  await page.locator(".earlier", { hasText: "There is no such job" }).waitFor();
  assert.equal(await page.locator(".earlier", { hasText: "of earlier on" }).count(), 0);
  await open(page, "Live");

  step("at the first start nothing has been done, and no job is offered that could measure nothing");
  await page.locator(".meter", { hasText: "frames are not measured: recorded frames say nothing" }).waitFor();
  await page.locator(".axes .tag", { hasText: "not homed" }).first().waitFor();
  await open(page, "Alignment");
  await page.locator(".job[data-state=none]", { hasText: "No job has been run" }).waitFor();
  await page.locator(".start", { hasText: "frames are not measured" }).waitFor();
  assert(await page.locator("#start").isDisabled(), "an alignment by recorded frames is offered");
  await open(page, "History");
  await page.locator(".history-page", { hasText: /No job/ }).waitFor();
  await open(page, "Live");

  step("a bench of hardware is not called simulated; frames of old are called a replay");
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  assert.doesNotMatch(await page.title(), /SIMULATED/);
  assert.match(await page.title(), /REPLAY/);
  const facts = await page.locator(".picture p.facts:not([role=note])").innerText();
  assert.match(facts, /frame \d+ · played \S+ \S+ ago/);
  assert.doesNotMatch(facts, / old|moving/);
  await page.locator("header .simulated", { hasText: "REPLAY" }).waitFor();
  await page.locator(".stamp", { hasText: "REPLAY" }).waitFor();

  step("a camera that is unplugged is said to be gone on every page, with the reason");
  renameSync(frames, `${frames}-gone`);
  await page.locator("#camera-gone", { hasText: frames }).waitFor({ timeout: 20_000 });
  await page.locator(".picture[data-state=stale] .over", { hasText: "STALE" }).waitFor({ timeout: 20_000 });
  await page.locator(".picture .tag.bad", { hasText: "The camera sends nothing" }).waitFor();
  await photograph(page, "camera-gone");
  await open(page, "Design");
  await page.locator("#camera-gone").waitFor();
  await open(page, "Live");

  step("plugged in again it shows by itself");
  renameSync(`${frames}-gone`, frames);
  await page.locator("#camera-gone").waitFor({ state: "detached", timeout: 20_000 });
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });

  step(
    "a picture that stands still because the page itself hangs is called stale, and what hangs is replaced",
  );
  const drawing = (worker) => /viewer-worker/.test(worker.url());
  const another = page.waitForEvent("worker", { predicate: drawing, timeout: 40_000 });
  void page
    .workers()
    .find(drawing)
    .evaluate(() => {
      for (;;);
    })
    .catch(() => {});
  await page.locator(".picture[data-state=stale] .over", { hasText: "STALE" }).waitFor({ timeout: 10_000 });
  await another;
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });

  step("a stage that is unplugged is said to be gone");
  unplug();
  await page.locator("#stage-gone", { hasText: "focus axis, e axis" }).waitFor({ timeout: 20_000 });
  assert.equal(await page.locator(".axes .tag", { hasText: "not connected" }).count(), 2);
  await photograph(page, "stage-gone");

  step("and to be back, its places unknown");
  stage = await plugIn();
  await page.locator("#stage-gone").waitFor({ state: "detached", timeout: 30_000 });
  await page.locator(".axes .tag", { hasText: "not homed" }).first().waitFor();

  step("an axis that stands on a limit switch is moved off it by its operator's word for which it is");
  unplug();
  await page.locator("#stage-gone").waitFor({ timeout: 20_000 });
  stage = await plugIn(ontoTheFarSwitch);
  await page.locator("#stage-gone").waitFor({ state: "detached", timeout: 30_000 });
  const focus = page.locator(".axis[data-axis=focus]");
  await focus.locator(".tag", { hasText: "limit switch pressed" }).waitFor();
  assert.equal(await page.locator(".axis[data-axis=e] .leave-switch").count(), 0);
  await open(page, "Alignment");
  await page.locator(".start", { hasText: "The focus axis stands on a limit switch: move it off" }).waitFor();
  assert(await page.locator("#start").isDisabled(), "what could not begin is offered");
  await page.screenshot({ path: `${shots}/start-on-a-switch.png` });
  await open(page, "Live");
  await focus.locator(".leave-switch").click();
  await focus.locator(".ask", { hasText: "which of its two limit switches is pressed" }).waitFor();
  await accessible(page);
  await photograph(page, "on-a-switch");
  await focus.getByRole("button", { name: "The one at the high end" }).click();
  await focus.locator(".leave-switch").waitFor({ state: "detached", timeout: 20_000 });
  await focus.getByRole("button", { name: "Home the focus axis" }).click();
  await focus.locator(".tag", { hasText: "not homed" }).waitFor({ state: "detached", timeout: 60_000 });

  step("the devices of the machine are listed");
  await open(page, "Settings");
  const devices = page.locator(".devices");
  await devices.locator("h3", { hasText: "Serial ports" }).waitFor();
  const found = await (await fetch(new URL("/api/v1/devices", address))).json();
  for (const { path } of [...found.cameras, ...found.serial_ports]) {
    await devices.locator("code", { hasText: path }).first().waitFor();
  }
  if (found.cameras.length === 0) await page.locator("#no-cameras").waitFor();

  step("the page can be installed as an app");
  await page.locator("#install:is([data-state=menu], [data-state=offered])").waitFor();
  const devtools = await page.context().newCDPSession(page);
  const { errors, url } = await devtools.send("Page.getAppManifest");
  assert.deepEqual([errors, new URL(url).pathname], [[], "/manifest.webmanifest"]);
  const { installabilityErrors } = await devtools.send("Page.getInstallabilityErrors");
  // The tests' browser keeps nothing, and installs nothing.
  const against = installabilityErrors.map(({ errorId }) => errorId).filter((id) => id !== "in-incognito");
  assert.deepEqual(against, []);

  step("the API's documentation and the audit log are found from the page");
  const records = page.locator(".records");
  const docs = await records.locator("a").getAttribute("href");
  assert.equal((await page.request.get(new URL(docs, address).href)).status(), 200);
  await records.locator("#audit summary").click();
  await records.locator("tbody tr", { hasText: "axis.leave_switch" }).first().waitFor();
  await photograph(page, "settings");
  await darken(page, "settings");

  assert.deepEqual(own(), []);
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  stage.kill("SIGKILL");
  place.remove();
  bench.remove();
}

/** Takes the link away with the twin, as udev does when a device goes: the terminal that it leads to will be another's. */
function unplug() {
  rmSync(link, { force: true });
  stage.kill("SIGKILL");
}

/** A stage controller's twin behind the link; resolves when it serves. What is done to it before is done aside. */
async function plugIn(before = async () => {}) {
  const aside = `${link}-aside`;
  const arguments_ = ["sim-stage", "--protocol", "grbl", "--link", aside, "--json", "--config", bench.file];
  const child = spawn(program, arguments_, { env: bench.env, stdio: ["ignore", "pipe", "inherit"] });
  await once(child.stdout, "data");
  await before(aside);
  renameSync(aside, link);
  return child;
}

/** Has another program run the focus axis onto the switch at its high end. */
async function ontoTheFarSwitch(port) {
  const line = await openFile(port, "r+");
  await line.write("$20=0\n$X\n$J=G91 G21 X7 F120\n");
  for (let heard = ""; !heard.includes("ALARM:1");) {
    const { buffer, bytesRead } = await line.read();
    heard += buffer.toString("latin1", 0, bytesRead);
  }
  await line.close();
}
