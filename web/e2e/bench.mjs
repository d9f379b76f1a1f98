// Two people at two browsers: who has control, jogging by press and hold, steps, large moves, homing, the stop key.

import assert from "node:assert/strict";
import { accessible, browse, faults, folder, open, photograph, resetStop, start, step } from "./harness.mjs";
import { drawn, until } from "./until.mjs";

const place = folder(`
[sensor]
width_px = 320
height_px = 320

[bench.simulation]
rays = 1
preview_rays = 1
preview_rate_hz = 2.0
`);

const daemon = start(place);
const browser = await browse();

try {
  const address = await daemon.address();
  const [ana, ben] = [await visit(address), await visit(address)];

  step("the space bar is a character while one types");
  await open(ana.page, "Settings");
  await ana.page.locator("#name").click();
  await ana.page.keyboard.type("Ana at the bench");
  assert.equal(await ana.page.locator("#name").inputValue(), "Ana at the bench");
  await open(ben.page, "Settings");
  await ben.page.locator("#name").fill("Ben");
  assert.equal((await bench()).stop.latched, false);

  step("it stops when one does not, and clicks nothing");
  await ana.page.getByRole("button", { name: "Take control" }).focus();
  await ana.page.keyboard.press("Space");
  await ana.page.locator("#reset").waitFor();
  assert.equal((await bench()).stop.latched, true);
  assert.equal((await bench()).lease ?? null, null, "the space bar clicked the button under the focus");
  await ana.page.locator(".stopped", { hasText: /Stopped at .* by local/ }).waitFor();
  await photograph(ana.page, "stopped-by");

  step("whoever resets it says why, and everybody sees who and why");
  await resetStop(ben.page, "the cable is free again");
  await ana.page
    .locator(".was-reset", { hasText: /^Ben reset the stop at .*: the cable is free again/ })
    .waitFor();
  await accessible(ana.page);
  await ana.page.locator(".was-reset button").click();
  await ana.page.locator(".was-reset").waitFor({ state: "detached" });

  step("another key can be the stop key");
  await ana.page.locator(".stop-key").getByRole("button", { name: "Change" }).click();
  await ana.page.locator(".stop-key", { hasText: "Press the key" }).waitFor();
  await ana.page.keyboard.press("F8");
  await ana.page.locator("#stop-key", { hasText: "F8" }).waitFor();
  await ana.page.locator("h1").click();
  const sent = [];
  ana.page.on("request", (request) => sent.push(new URL(request.url()).pathname));
  await ana.page.keyboard.press("Space");
  await drawn(ana.page);
  assert(!sent.includes("/api/v1/stop"), "the space bar stops although another key does");
  assert.equal((await bench()).stop.latched, false);
  await ana.page.keyboard.press("F8");
  await resetStop(ana.page, "the key is tried");
  await ana.page.getByRole("button", { name: "Back to Space" }).click();

  step("homing is a job as well; its starter has control, and others see who");
  await open(ana.page, "Alignment");
  await ana.page.locator("#kind").selectOption("focus_sweep");
  await ana.page.locator("#start").click();
  assert.equal(await ana.page.locator(".start .fault").count(), 2, "a sweep without its ends is not refused");
  await ana.page.locator('.start input[name="from_mm"]').fill("0");
  await ana.page.locator('.start input[name="to_mm"]').fill("1");
  await ana.page.locator(".start .aim", { hasText: "11 positions, 0.1000 mm apart" }).waitFor();
  await ana.page.locator("#kind").selectOption("clarity_only");
  await ana.page.locator(".start .aim", { hasText: "Δv 1.7448 mm at e 30.00 mm" }).waitFor();
  await ana.page.locator('.start input[name="e_mm"]').fill("0");
  await ana.page.locator(".start .aim", { hasText: "Δv 2.2050 mm at e 0.00 mm" }).waitFor();
  await ana.page.locator("#kind").selectOption("homing");
  await ana.page.locator("#start").click();
  await ana.page.locator(".job .outcome.succeeded").waitFor({ timeout: 60_000 });
  assert.match(await ana.page.locator(".result").innerText(), /e axis\s+30\.000 mm/);
  await ana.page.locator(".lease[data-lease=mine]").waitFor();
  await ben.page.locator(".lease[data-lease=others]", { hasText: "Ana at the bench has control" }).waitFor();

  step("an axis moves while its button is held, and no longer");
  for (const { page } of [ana, ben]) {
    await open(page, "Live");
    await page.locator(".axes").waitFor();
  }
  const forward = hold(ana.page, "focus", "high");
  const before = await position("focus");
  await press(ana.page, forward);
  await until(
    async () => (await position("focus")) > before + 0.2,
    "the axis does not move while it is held",
  );
  await ana.page.locator(".hold[data-held=true]").waitFor();
  await photograph(ana.page, "jog");
  await ana.page.mouse.up();
  await still("focus", "the axis moves on after the release");

  step("a button held through a stop and its reset moves nothing until it is pressed again");
  await forward.scrollIntoViewIfNeeded();
  await press(ana.page, forward);
  const held = await position("focus");
  await until(async () => (await position("focus")) > held + 0.1, "the axis does not move");
  await ask("POST");
  await ask("DELETE", { why: "a test", owner: "Ben" });
  assert.equal((await bench()).stop.latched, false);
  await still("focus", "a button that was held resumes by the reset");
  await ana.page.mouse.up();
  const pressed = await position("focus");
  await press(ana.page, hold(ana.page, "focus", "low"));
  await until(async () => (await position("focus")) < pressed - 0.1, "pressed anew, it does not move");
  await ana.page.mouse.up();
  await still("focus", "the axis moves on after the release");
  for (const notice of [".problem", ".was-reset"]) {
    const shown = ana.page.locator(`header ${notice}`);
    if (await shown.isVisible()) await shown.locator("button").click();
    await shown.waitFor({ state: "detached" });
  }

  step("it ends by the deadman where the page is not heard any more");
  await forward.scrollIntoViewIfNeeded();
  await press(ana.page, forward);
  const going = await position("focus");
  await until(async () => (await position("focus")) > going + 0.1, "the axis does not move");
  await ana.page.route("**/jog", (route) => route.abort());
  await still("focus", "the axis moves on although nothing is heard from the page");
  await ana.page.locator(".problem").first().waitFor();
  await ana.page.mouse.up();
  await ana.page.unroute("**/jog");
  await ana.page.locator(".problem button").first().click();

  step("who has no control is refused in the daemon's words");
  await press(ben.page, hold(ben.page, "focus", "low"));
  await ben.page
    .locator(".problem", { hasText: /^Somebody else has control\. Ana at the bench has the control lease/ })
    .waitFor();
  await ben.page.mouse.up();
  await ben.page.locator(".problem button").click();

  step("a step goes by what it says");
  const from = await position("focus");
  await ana.page.getByRole("button", { name: "Move the focus axis by −0.100 mm" }).click();
  await until(async () => Math.abs((await position("focus")) - (from - 0.1)) < 0.01, "no step was made");
  await until(async () => !(await bench()).axes.some((axis) => axis.moving), "the step does not end");
  await until(
    async () => (await ana.page.locator(".axes .tag", { hasText: "moving" }).count()) === 0,
    "the page shows an axis as moving that is still",
  );

  step("a large move is asked about; STOP stays within reach");
  const field = ana.page.getByLabel("Move the focus axis to, mm");
  await field.fill("4.5");
  await field.press("Enter");
  await ana.page.locator(".ask").waitFor();
  assert.equal(await ana.page.locator(".ask button:focus").textContent(), "Don’t");
  await photograph(ana.page, "large-move");
  await ana.page.locator(".ask button:focus").click();
  await frames(2);
  assert(Math.abs((await position("focus")) - (from - 0.1)) < 0.01, "it moved although it was told not to");
  await field.press("Enter");
  await ana.page.locator(".ask .primary").click();
  await until(async () => (await position("focus")) > 4.4, "the move was not made");
  await until(async () => !(await bench()).axes.some((axis) => axis.moving), "the move does not end");
  await until(
    async () => (await ana.page.locator(".axes .tag", { hasText: "moving" }).count()) === 0,
    "the page shows an axis as moving that is still",
  );

  step("a place beyond the limits is named as such");
  await field.fill("90");
  await ana.page.locator(".axes .fault", { hasText: "from −2.00 mm to 5.00 mm" }).waitFor();
  await field.press("Enter");
  await ana.page.locator(".ask .primary").click();
  await ana.page.locator("header .problem").waitFor();
  await ana.page.locator("header .problem button").click();

  step("control is taken over, after a question, and the other sees it");
  await ben.page.getByRole("button", { name: "Take over…" }).click();
  await ben.page.locator(".lease .ask", { hasText: "Ana at the bench" }).waitFor();
  await ben.page.getByRole("button", { name: "Take over", exact: true }).click();
  await ben.page.locator(".lease[data-lease=mine]").waitFor();
  await ana.page.locator(".lease[data-lease=others]", { hasText: "Ben has control" }).waitFor();
  const taken = await position("focus");
  await press(ana.page, forward);
  await ana.page.locator("header .problem").waitFor();
  await ana.page.mouse.up();
  assert(Math.abs((await position("focus")) - taken) < 0.01, "it moved without control");
  await photograph(ana.page, "taken-over");

  step("given back, it is free for everybody");
  await ben.page.getByRole("button", { name: "Release control" }).click();
  await ana.page.locator(".lease[data-lease=free]").waitFor();

  step("nothing on any page keeps out who cannot see or has no mouse");
  for (const name of ["Live", "Alignment", "Design", "History", "Settings"]) {
    await open(ana.page, name);
    for (const width of [360, 1280]) {
      await ana.page.setViewportSize({ width, height: 900 });
      for (const colorScheme of ["dark", "light"]) {
        await ana.page.emulateMedia({ colorScheme });
        await drawn(ana.page);
        await accessible(ana.page);
      }
    }
  }

  for (const { own } of [ana, ben]) assert.deepEqual(own(), []);

  async function bench() {
    return (await fetch(new URL("/api/v1/bench", address))).json();
  }

  async function ask(method, body) {
    const headers = { "content-type": "application/json" };
    const asked = { method, headers, ...(body ? { body: JSON.stringify(body) } : {}) };
    const answer = await fetch(new URL("/api/v1/stop", address), asked);
    assert(answer.ok, await answer.text());
  }

  async function position(name) {
    return (await bench()).axes.find((axis) => axis.axis === name).position_mm;
  }

  /** Waits for so many frames, two a second: whatever moves does so in them. */
  async function frames(count) {
    const last = (await bench()).camera.frame_seq + count;
    await until(async () => (await bench()).camera.frame_seq >= last, "no frame comes");
  }

  /** The deadman waits 0.3 s, and an axis needs a moment to stop. */
  async function still(name, otherwise) {
    await until(async () => !(await bench()).axes.some((axis) => axis.moving), otherwise);
    const there = await position(name);
    await frames(2);
    assert(Math.abs((await position(name)) - there) < 1e-6, otherwise);
  }
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  place.remove();
}

/** Somebody with a browser of their own. */
async function visit(address) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 1000 } });
  const page = await context.newPage();
  const own = faults(page);
  await page.goto(address);
  await page.locator(".axes").waitFor();
  return { page, own };
}

function hold(page, axis, side) {
  return page.locator(`.hold[data-axis=${axis}][data-side=${side}]`);
}

/** Presses a button and does not let go. */
async function press(page, button) {
  await button.scrollIntoViewIfNeeded();
  await button.hover();
  await page.mouse.down();
}
