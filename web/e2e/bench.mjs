// Two people at two browsers: who has control, jogging by press and hold, steps, large moves, homing, the stop key.

import assert from "node:assert/strict";
import {
  accessible,
  browse,
  darken,
  faults,
  fits,
  folder,
  lateLine,
  open,
  photograph,
  resetStop,
  start,
  step,
} from "./harness.mjs";
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

/** Far less than the minute that a silent connection takes to close; that it is 3 s is held by `live.test.ts`. */
const LOST_MS = 20_000;

const daemon = start(place);
const browser = await browse();

try {
  const address = await daemon.address();
  const [ana, ben] = [await visit(address), await visit(address)];

  step("a name is asked for once, to be shown to others");
  const naming = ana.page.locator(".ask-name");
  await naming.locator("input").fill("Ana");
  await photograph(ana.page, "name-asked");
  await naming.locator("input").press("Enter");
  await naming.waitFor({ state: "detached" });
  await ben.page.locator("#no-name").click();
  for (const { page } of [ana, ben]) {
    await page.reload();
    await page.locator(".axes").waitFor();
    assert.equal(await page.locator(".ask-name").count(), 0, "a name is asked for again");
  }

  step("the space bar is a character while one types");
  await open(ana.page, "Settings");
  await ana.page.locator("#name").click();
  await ana.page.keyboard.press("End");
  await ana.page.keyboard.type(" at the bench");
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
  await ana.page.locator(".stopped", { hasText: /Stopped at .* by Ana at the bench/ }).waitFor();
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

  step("a stop is reset from the keyboard, which goes on from the page's content");
  await ana.page.locator("#reset").press("Enter");
  await ana.page.locator("#why:focus").waitFor();
  await ana.page.keyboard.type("the key is tried");
  await ana.page.keyboard.press("Enter");
  await ana.page.locator(".stopped").waitFor({ state: "detached" });
  await ana.page.locator("#content:focus").waitFor();
  await ana.page.getByRole("button", { name: "Back to Space" }).click();

  step("homing is a job as well; its starter has control, and others see who");
  await open(ana.page, "Alignment");
  await ana.page.locator("#kind").selectOption("focus_sweep");
  await ana.page.locator(".start", { hasText: "The focus axis has no place before it is homed" }).waitFor();
  assert(
    await ana.page.locator("#start").isDisabled(),
    "a sweep between places that are not known is offered",
  );
  await ana.page.locator('.start input[name="from_mm"]').fill("0");
  await ana.page.locator('.start input[name="to_mm"]').fill("1");
  await ana.page.locator(".start .aim", { hasText: "11 positions, 0.1000 mm apart" }).waitFor();
  await ana.page.locator("#kind").selectOption("clarity_only");
  await ana.page.locator(".start .aim", { hasText: "Δv 1.7448 mm at e 30.00 mm" }).waitFor();
  await ana.page.locator('.start input[name="e_mm"]').fill("0");
  await ana.page.locator(".start .aim", { hasText: "Δv 2.2050 mm at e 0.00 mm" }).waitFor();
  // The plan is for the e that is typed, and refuses one at which the shell cannot be mounted.
  await ana.page.locator(".start #plan[role=alert]").waitFor();
  assert(await ana.page.locator("#start").isDisabled(), "a clarity job is offered where the lens touches");
  await ana.page.locator('.start input[name="e_mm"]').fill("20");
  await ana.page.locator(".start #plan", { hasText: "e is held at 20.0 mm" }).waitFor();
  // What is no one number is marked as it is typed, and nothing is said of another e.
  await ana.page.locator('.start input[name="e_mm"]').fill("1,234");
  await ana.page.locator('.start input[name="e_mm"][aria-invalid=true]').waitFor();
  assert.equal(
    await ana.page.locator(".start :is(#plan, .aim)").count(),
    0,
    "a plan for an e that nobody typed",
  );
  await ana.page.locator("#kind").selectOption("homing");
  await ana.page.locator("#start").click();
  await ana.page.locator(".job .outcome.succeeded").waitFor({ timeout: 60_000 });
  assert.match(await ana.page.locator(".result").innerText(), /e axis\s+30\.000 mm/);
  await ana.page.locator("#kind").selectOption("focus_sweep");
  for (const name of ["from_mm", "to_mm"]) await ana.page.locator(`.start input[name="${name}"]`).fill("");
  await ana.page.locator("#start").click();
  assert.equal(await ana.page.locator(".start .fault").count(), 2, "a sweep without its ends is not refused");
  await ana.page.locator(".lease[data-lease=mine]").waitFor();
  await ben.page.locator(".lease[data-lease=others]", { hasText: "Ana at the bench has control" }).waitFor();

  step("a tab that is opened from the one that has control does not have it, too");
  const opened = ana.page.waitForEvent("popup");
  await ana.page.evaluate(() => void window.open(location.href));
  const copy = await opened;
  await copy
    .locator(".lease[data-lease=others]", { hasText: "Ana at the bench (in another window)" })
    .waitFor();
  await copy.close();
  await ana.page.locator(".lease[data-lease=mine]").waitFor();

  for (const { page } of [ana, ben]) {
    await open(page, "Live");
    await page.locator(".axes").waitFor();
  }

  step("a place nearer to the shell than e is known is refused, with the reason");
  const e = ana.page.locator(".axis[data-axis=e]");
  await e.locator("input").fill("1");
  await e.locator(".untold", { hasText: "zero_uncertainty_mm" }).waitFor();
  assert(
    await e.getByRole("button", { name: "Go", exact: true }).isDisabled(),
    "e is sent too near the shell",
  );
  await e.locator("input").fill("");
  await e.locator(".untold").waitFor({ state: "detached" });

  step("an axis moves while its button is held, and no longer");
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
  // The button of before loses the focus by it.
  for (const [axis, side, sign] of [
    ["focus", "low", -1],
    ["e", "high", 1],
    ["focus", "high", 1],
  ]) {
    const then = await position(axis);
    await press(ana.page, hold(ana.page, axis, side));
    await until(
      async () => sign * ((await position(axis)) - then) > 0.1,
      `the ${axis} axis does not move while another button is held`,
    );
    await ana.page.mouse.up();
    await still(axis, "the axis moves on after the release");
  }
  // Whoever has gone too far turns round before the axis stands.
  await press(ana.page, forward);
  await until(async () => (await bench()).axes.some((axis) => axis.moving), "the axis does not move");
  await ana.page.mouse.up();
  await press(ana.page, hold(ana.page, "focus", "low"));
  const turned = await position("focus");
  await until(async () => (await position("focus")) < turned - 0.1, "the axis does not turn round");
  assert.deepEqual(await ana.page.locator("header .problem").allInnerTexts(), [], "turning round is refused");
  // A stop takes the focus from it, and gives it back.
  await ana.page.keyboard.press("Space");
  await ana.page.locator("#reset:focus").waitFor();
  await ana.page.mouse.up();
  await resetStop(ana.page, "tried while it was held");
  await until(
    () => hold(ana.page, "focus", "low").evaluate((it) => it === document.activeElement),
    "the button has not the focus again",
  );

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

  step("who has no control is offered nothing that moves, and told who has it");
  assert(await hold(ben.page, "focus", "low").isDisabled());
  await ben.page
    .locator(".axes", { hasText: "Ana at the bench has control: nothing can be moved" })
    .waitFor();
  await ana.page.locator(".lease[data-lease=mine]", { hasText: "as Ana at the bench" }).waitFor();

  step("a step goes by what it says, and leaves whoever steps by key where they are");
  const from = await position("focus");
  const back = ana.page.getByRole("button", { name: "Move the focus axis by −0.100 mm" });
  await back.press("Enter");
  await until(async () => Math.abs((await position("focus")) - (from - 0.1)) < 0.01, "no step was made");
  await until(async () => !(await bench()).axes.some((axis) => axis.moving), "the step does not end");
  await until(
    async () => (await ana.page.locator(".axes .tag", { hasText: "moving" }).count()) === 0,
    "the page shows an axis as moving that is still",
  );
  assert(await back.evaluate((button) => button === document.activeElement), "the focus is lost by a step");

  step("exposure and gain are set within their limits by whoever has control, and everybody sees to what");
  const exposure = (page) => page.locator(".camera [data-control=exposure] input");
  await shows(exposure(ana.page), "10.0");
  await exposure(ana.page).fill("250");
  await ana.page.locator(".camera .fault", { hasText: "It may be 0.1 to 100.0 ms." }).waitFor();
  assert(await ana.page.getByRole("button", { name: "Set the exposure" }).isDisabled());
  await exposure(ana.page).fill("100");
  await exposure(ana.page).press("Enter");
  for (const { page } of [ana, ben]) await shows(exposure(page), "100.0");
  assert(await exposure(ben.page).isDisabled());
  await ben.page.locator("#camera-barred", { hasText: "Ana at the bench has control" }).waitFor();

  step("what is clipped is red in the histogram, and the exposure that fits is found");
  await ana.page.locator(".histogram").scrollIntoViewIfNeeded();
  await ana.page.locator(".histogram[data-clipped=true]").waitFor({ timeout: 20_000 });
  await ana.page.locator("#clipped.bad", { hasText: /^clipped \d+\.\d\d %$/ }).waitFor();
  await accessible(ana.page);
  await photograph(ana.page, "clipped");
  await darken(ana.page, "clipped");
  await exposure(ana.page).fill("rubbish");
  await ana.page.locator("#auto-exposure").press("Enter");
  await ana.page
    .locator(".auto-exposure [role=status]", { hasText: /at [78]\d % of white, 0\.[01]\d % are clipped/ })
    .waitFor({ timeout: 30_000 });
  await ana.page.locator(".histogram[data-clipped=false]").waitFor({ timeout: 20_000 });
  assert(Number(await exposure(ana.page).inputValue()) < 100);
  await ana.page.locator("#auto-exposure:focus").waitFor();
  await photograph(ana.page, "exposed");

  step("a large move is asked about; STOP stays within reach");
  const field = ana.page.getByLabel("Move the focus axis to, mm");
  await field.fill("4.5");
  await asked(ana.page, field);
  await field.press("End");
  await field.press("5");
  await ana.page.locator(".ask").waitFor({ state: "detached" });
  await shows(field, "4.55");
  await asked(ana.page, field);
  assert.equal(await ana.page.locator(".ask button:focus").textContent(), "Don’t");
  await photograph(ana.page, "large-move");
  await ana.page.locator(".ask button:focus").click();
  await asked(ana.page, field);
  // It takes no answer at once.
  await ana.page.locator(".ask .primary:not([aria-disabled=true])").waitFor();
  await ana.page.keyboard.press("Escape");
  await ana.page.locator(".ask").waitFor({ state: "detached" });
  await frames(2);
  assert(Math.abs((await position("focus")) - (from - 0.1)) < 0.01, "it moved although it was told not to");
  await asked(ana.page, field);
  await ana.page.locator(".ask .primary").click();
  await ana.page.locator(".axis[data-axis=focus] .tag", { hasText: "moving" }).waitFor();
  // What moves already is not moved by a button that is held; that it moves is no news once it stands.
  await press(ana.page, hold(ana.page, "focus", "low"));
  const refused = ana.page.locator("header .problem", { hasText: "Not while the axis moves" });
  await refused.waitFor();
  await ana.page.mouse.up();
  await until(async () => (await position("focus")) > 4.4, "the move was not made");
  await refused.waitFor({ state: "detached" });
  await until(async () => !(await bench()).axes.some((axis) => axis.moving), "the move does not end");
  await until(
    async () => (await ana.page.locator(".axes .tag", { hasText: "moving" }).count()) === 0,
    "the page shows an axis as moving that is still",
  );

  step("a place beyond the limits, or none, is named as such, and not asked about");
  await field.fill("abc");
  await ana.page.locator(".axes .fault", { hasText: "no number" }).waitFor();
  await field.fill("90");
  await ana.page.locator(".axes .fault", { hasText: "from −2.00 mm to 5.00 mm" }).waitFor();
  await field.press("Enter");
  await frames(2);
  assert.equal(await ana.page.locator(".ask").count(), 0, "what is refused is asked about");
  assert(await ana.page.locator(".manual").first().getByRole("button", { name: "Go" }).isDisabled());

  step("Space stops in a field for numbers, too; that it did is no fault of the axis once the stop is reset");
  await field.fill("-1.5");
  await field.press("Enter");
  await ana.page.locator(".ask .primary").click();
  // One controller moves both.
  await ana.page.locator(".axes .tag", { hasText: "moving" }).first().waitFor();
  await field.press("Space");
  await ana.page.locator(".stopped").waitFor();
  assert.doesNotMatch(await field.inputValue(), /\s/);
  const stopped = ana.page.locator(".axis .tag.bad", { hasText: "the focus axis was stopped" });
  await stopped.waitFor();
  // Whoever is at the keyboard is led to the reset, and back to where it was stopped.
  await ana.page.locator("#reset:focus").waitFor();
  await resetStop(ana.page, "the way is clear");
  await stopped.waitFor({ state: "detached" });
  await until(
    () => field.evaluate((it) => it === document.activeElement),
    "the field has not the focus again",
  );

  step("after a reload the charts show what the axes did before");
  await ana.page.reload();
  await ana.page.locator(".charts canvas").nth(2).waitFor();
  await until(() => ana.page.evaluate(traced), "the chart of the axes begins empty");
  await photograph(ana.page, "reloaded");

  step("a question about taking control over ends with the control that it was about");
  await ana.page.locator(".lease[data-lease=mine]").waitFor();
  await ben.page.getByRole("button", { name: "Take over…" }).click();
  await ben.page.locator(".lease .ask").waitFor();
  await ana.page.getByRole("button", { name: "Release control" }).click();
  await ben.page.locator(".lease[data-lease=free]").waitFor();
  await ana.page.getByRole("button", { name: "Take control" }).click();
  await ben.page.locator(".lease[data-lease=others]", { hasText: "Take over…" }).waitFor();
  assert.equal(await ben.page.locator(".lease .ask").count(), 0);

  step(
    "control is taken over, after a question, and the other is told at once: a button held down goes dead",
  );
  const low = hold(ana.page, "focus", "low");
  await press(ana.page, low);
  const running = await position("focus");
  await until(async () => (await position("focus")) < running - 0.1, "the axis does not move");
  await ben.page.getByRole("button", { name: "Take over…" }).click();
  await ben.page.locator(".lease .ask", { hasText: "Ana at the bench" }).waitFor();
  await ben.page.getByRole("button", { name: "Take over", exact: true }).click();
  await ben.page.locator(".lease[data-lease=mine]").waitFor();
  await ana.page.locator(".lease[data-lease=others]", { hasText: "Ben has control" }).waitFor();
  const lost = ana.page.locator(".control-lost", { hasText: "Ben has taken control from you." });
  await lost.waitFor();
  assert.equal(await low.getAttribute("data-held"), "false");
  assert(await low.isDisabled());
  await still("focus", "it moves on without control");
  await ana.page.mouse.up();
  await photograph(ana.page, "taken-over");
  await accessible(ana.page);
  await lost.locator("button").click();
  await lost.waitFor({ state: "detached" });

  step("another language is spoken at once: control and what is being typed are kept, and it fits a phone");
  await open(ben.page, "Settings");
  const find = ben.page.locator(".find input");
  await find.fill("blur");
  await ben.page.getByRole("button", { name: "Deutsch" }).click();
  await ben.page.locator("html[lang=de] .preferences", { hasText: "Diese Seite" }).waitFor();
  assert.equal(await find.inputValue(), "blur");
  const size = ben.page.viewportSize();
  for (const link of await ben.page.locator("nav a").all()) {
    await link.click();
    await ben.page.locator("nav a[aria-current]", { hasText: await link.innerText() }).waitFor();
    await fits(ben.page, 360);
  }
  await ben.page.setViewportSize(size);
  await ben.page.reload();
  await ben.page
    .locator(".lease[data-lease=mine]", { hasText: "Diese Seite hat die Bedienhoheit (Ben)" })
    .waitFor();
  assert.deepEqual(await ben.page.evaluate(catalogues), ["de"], "words are loaded that nobody reads");
  await ben.page.getByRole("button", { name: "English" }).click();

  step("given back, it is free for everybody");
  await ben.page.locator(".lease button[aria-disabled=false]", { hasText: "Release control" }).press("Enter");
  await ana.page.locator(".lease[data-lease=free]").waitFor();
  await ben.page.locator(".lease[data-lease=free] button:focus", { hasText: "Take control" }).waitFor();

  step("over a line that is late from the first what comes is old, however steadily it comes");
  const line = await lateLine(address, 2500);
  const late = await visit(line.address);
  await late.page.locator(".picture[data-state=stale] .over", { hasText: /STALE · [2-9]/ }).waitFor();
  await late.page.context().close();
  line.close();
  await ana.page.locator(".picture[data-state=fresh]").waitFor();

  step("a daemon that is frozen is said to be lost, what may be old is marked so, and no command is offered");
  await open(ana.page, "Live");
  const far = (await position("focus")) > 1.5 ? "-1.5" : "4.5";
  await field.fill(far);
  await field.press("Enter");
  const question = ana.page.locator(".axes .ask");
  await question.waitFor();
  daemon.process.kill("SIGSTOP");
  await ana.page.locator(".link[data-link=lost]").waitFor({ timeout: LOST_MS });
  await ana.page.locator(".lease[data-lease=unclear]").waitFor();
  await question.waitFor({ state: "detached" });
  for (const card of [".axes", ".camera"]) {
    await ana.page.locator(`${card} .tag.old`, { hasText: /^OLD · \d+ s$/ }).waitFor();
  }
  await ana.page.locator("#camera-barred", { hasText: "The daemon is not heard." }).waitFor();
  for (const button of await ana.page
    .locator(".lease button, .axes form button, .axes .shell button, .camera button")
    .all()) {
    assert(await button.isDisabled(), `${await button.innerText()} is offered`);
  }
  // What is being typed then is not lost: the focus is back where it was asked from.
  await ana.page.keyboard.press("End");
  await ana.page.keyboard.type("1");
  await shows(field, `${far}1`);
  assert(await exposure(ana.page).isEnabled());
  await open(ana.page, "Alignment");
  assert(await ana.page.locator("#start").isDisabled());
  step("but STOP is tried, and said not to be delivered");
  assert(await ana.page.locator("#stop").isEnabled());
  await ana.page.locator("#stop").click();
  await ana.page.locator(".stop-failed", { hasText: "STOP WAS NOT DELIVERED" }).waitFor({ timeout: LOST_MS });
  await open(ana.page, "Live");
  await until(async () => /^CONNECTION LOST/.test(await ana.page.title()), "the title does not say it");
  await photograph(ana.page, "frozen");
  daemon.process.kill("SIGCONT");
  await ana.page.locator(".link").waitFor({ state: "detached", timeout: 20_000 });
  step("which is over when the connection is back, and known to have been late");
  await ana.page.locator(".stop-failed").waitFor({ state: "detached" });
  await resetStop(ana.page, "it came late");
  assert.equal(await question.count(), 0, "a question of before can be answered again");

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

  step(
    "the first token is made after a question, stays in sight, and signs its maker in; everybody else is asked for one",
  );
  await open(ana.page, "Settings");
  const tokens = ana.page.locator(".tokens");
  await tokens.getByText("anyone who reaches the daemon may command it").waitFor();
  await tokens.locator("#token-name").fill("Ana");
  await tokens.getByRole("button", { name: "may look and stop" }).click();
  await tokens.getByRole("button", { name: "Make a token" }).click();
  await tokens.locator(".ask", { hasText: "you lock yourself out" }).waitFor();
  await photograph(ana.page, "first-token-asked");
  await tokens.getByRole("button", { name: "Don’t" }).click();
  await tokens.getByRole("button", { name: "may do everything" }).click();
  await tokens.getByRole("button", { name: "Make a token" }).click();
  await tokens
    .locator(".ask", { hasText: /everybody is asked for one.* signs in with it by itself/ })
    .waitFor();
  await tokens.locator(".ask .primary").click();
  const secret = ana.page.locator("header #secret code");
  await secret.waitFor();
  await ana.page.locator("#copy-secret:focus").waitFor();
  await ana.page.locator(".who", { hasText: "Ana" }).waitFor();
  await ben.page
    .locator("#sign-in #out", { hasText: "From now on everybody is asked for a token" })
    .waitFor();
  await ana.page.locator(".token-list li", { hasText: "Ana" }).waitFor();
  await ana.page.setViewportSize({ width: 360, height: 740 });
  await drawn(ana.page);
  const box = await secret.boundingBox();
  assert(
    box.x >= 0 && box.x + box.width <= 360 && box.y >= 0 && box.y + box.height <= 740,
    "it is half off-screen",
  );
  await open(ana.page, "Live");
  await ana.page.locator(".axes").waitFor();
  await photograph(ana.page, "first-token");
  await accessible(ana.page);
  await ana.page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
  await ana.page.locator("#copy-secret").click();
  await ana.page.locator("#secret", { hasText: "Copied." }).waitFor();
  const key = await ana.page.evaluate(() => navigator.clipboard.readText());
  assert.equal(key, await secret.innerText());
  await ana.page.locator("#secret-kept").click();
  await secret.waitFor({ state: "detached" });
  await ana.page.locator("#content:focus").waitFor();

  step("by it others get in; whoever revokes the last one is told that everybody is locked out");
  await ben.page.locator("#sign-in input").fill(key);
  await ben.page.locator("#sign-in input").press("Enter");
  await ben.page.locator(".who", { hasText: "Ana" }).waitFor();
  await ben.page.locator("#content:focus").waitFor();
  await open(ana.page, "Settings");
  await tokens.getByRole("button", { name: "Revoke the token of Ana" }).click();
  await tokens.locator(".ask", { hasText: /you lock yourself out.*everybody is locked out/ }).waitFor();
  // The list of tokens is asked for anew meanwhile.
  const listed = () => ana.page.waitForResponse((answer) => answer.url().endsWith("/api/v1/tokens"));
  await (await listed()).finished();
  await (await listed()).finished();
  await tokens.locator(".ask", { hasText: /you lock yourself out.*everybody is locked out/ }).waitFor();
  await tokens.getByRole("button", { name: "Keep it" }).click();

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

/** In the page: whether the chart of the axes has a line where what was 20 s and more ago is. */
function traced() {
  const canvas = document.querySelectorAll(".charts canvas")[2];
  const { data, width } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  for (let at = 0; at < data.length; at += 4) {
    const x = ((at / 4) % width) / width;
    if (x > 0.5 && x < 0.75 && data[at + 3] > 0 && data[at + 2] - data[at] > 90) return true;
  }
  return false;
}

/** In the page: the languages whose words have been loaded. */
function catalogues() {
  const names = performance
    .getEntriesByType("resource")
    .map(({ name }) => /\/assets\/(en|de)\b/.exec(name)?.[1]);
  return names.filter((name) => name !== undefined);
}

function hold(page, axis, side) {
  return page.locator(`.hold[data-axis=${axis}][data-side=${side}]`);
}

/** Waits until a field has this in it. */
async function shows(field, text) {
  await field.waitFor();
  await until(
    async () => (await field.inputValue()) === text,
    async () =>
      `a field shows ${await field.inputValue()} for ${text}; enabled: ${await field.isEnabled()}, focus: ${await field.evaluate(() => document.activeElement.outerHTML)}`,
  );
}

/** Has a large move of the focus axis asked about with Enter, once the page takes commands. */
async function asked(page, field) {
  const axis = page.locator(".axis[data-axis=focus]");
  const go = axis.getByRole("button", { name: "Go", exact: true });
  await until(() => go.isEnabled(), "the page takes no command");
  await field.press("Enter");
  const ask = page.locator(".ask");
  await until(
    () => ask.isVisible(),
    async () =>
      `a move to ${await field.inputValue()} is not asked about: ${await page.locator("header").innerText()} ${await axis.innerText()}`,
  );
}

/** Presses a button and does not let go. */
async function press(page, button) {
  await button.scrollIntoViewIfNeeded();
  await button.hover();
  await page.mouse.down();
}
