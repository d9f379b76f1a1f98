// Faults of the simulated bench, made and made good from the page, and what the page then shows: the meter, which reads every
// frame, among it.

import assert from "node:assert/strict";
import { accessible, browse, darken, faults, folder, open, photograph, start, step } from "./harness.mjs";
import { until } from "./until.mjs";

/** Frames a second of the simulated camera unless set otherwise are more. */
const LEAST_HZ = 10;
/** Figures painted that this is judged by. */
const FIGURES = 30;
const bench = folder(`
[sensor]
width_px = 320
height_px = 320

[bench.simulation]
rays = 16
operator_confirms = false
`);
const daemon = start(bench);
const browser = await browse();

try {
  const address = await daemon.address();
  const page = await browser.newPage({ viewport: { width: 1024, height: 900 } });
  const own = faults(page);
  await page.goto(address);
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  await open(page, "Settings");
  const panel = page.locator(".faults");
  const state = panel.locator("#faults-state");
  await state.filter({ hasText: "Nothing is wrong" }).waitFor();
  assert(await panel.locator("#faults-none").isDisabled());
  const camera = panel.getByRole("group", { name: "Camera", exact: true });

  step("before there is a white frame the meter says where to begin");
  await open(page, "Live");
  await page.locator(".meter", { hasText: "an alignment begins with one" }).waitFor();
  await open(page, "Settings");

  step("a plan of faults to come is told, and called off");
  await page.evaluate(() =>
    fetch("/api/v1/simulation/fault-plan", {
      method: "PUT",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({ events: [{ at_s: 3600, faults: { camera: { unplugged: true } } }] }),
    }),
  );
  await panel.locator("#faults-planned").waitFor();
  await state.filter({ hasText: "Nothing is wrong now" }).waitFor();
  await panel.locator("#faults-none").click();
  await panel.locator("#faults-planned").waitFor({ state: "detached" });
  assert(await panel.locator("#faults-none").isDisabled());

  step("a camera is unplugged, and every page says so");
  await camera.getByRole("button", { name: "Unplugged" }).click();
  await state.filter({ hasText: "wrong on purpose" }).waitFor();
  await page.locator("#camera-gone", { hasText: "unplugged" }).waitFor();
  await accessible(page);
  await photograph(page, "faults");
  await open(page, "Live");
  await page.locator(".picture[data-state=stale]").waitFor({ timeout: 20_000 });

  step("a controller is unplugged as well, and an axis slips");
  await open(page, "Settings");
  await panel
    .getByRole("group", { name: "Controller’s line" })
    .getByRole("button", { name: "Unplugged" })
    .click();
  const slip = panel.getByRole("group", { name: "e axis" }).getByLabel("Slips by");
  await slip.fill("12,5");
  // What comes meanwhile leaves what is being typed as it is.
  await page.locator("#stage-gone").waitFor({ timeout: 20_000 });
  await slip.blur();
  await page.waitForFunction(async () => {
    const now = await (await fetch("/api/v1/simulation/faults")).json();
    return now.e.slip_share === 0.125 && now.serial.unplugged && now.camera.unplugged;
  });

  step("whatever the header has to say, the meter by itself is seen below it");
  const alone = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  await alone.goto(new URL("#/meter", address).href);
  await alone.locator("#camera-gone").waitFor();
  await alone.locator("#stage-gone").waitFor();
  const room = await alone.evaluate(() => [document.documentElement.scrollHeight, innerHeight]);
  assert(room[0] <= room[1], `${room[0]} px on a screen of ${room[1]}`);
  const { top, bottom } = await alone
    .locator(".huge .number")
    .evaluate((number) => number.getBoundingClientRect().toJSON());
  assert(top > 0 && bottom < 800 && bottom - top > 80, `from ${top} to ${bottom}`);
  await alone.close();

  step("a page opened later shows what is wrong; made good, the picture comes back by itself");
  const other = await browser.newPage({ viewport: { width: 1024, height: 900 } });
  await other.goto(address);
  await open(other, "Settings");
  await other.locator("#faults-state", { hasText: "wrong on purpose" }).waitFor();
  await other.locator("#faults-none").click();
  await other.locator("#faults-state", { hasText: "Nothing is wrong" }).waitFor();
  await open(other, "Live");
  await other.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  await other.locator("#camera-gone").waitFor({ state: "detached", timeout: 20_000 });
  await other.locator("#stage-gone").waitFor({ state: "detached", timeout: 30_000 });

  step("a camera that gives an old picture again as if it were new does not pass for a live one");
  await open(page, "Settings");
  await camera.getByRole("button", { name: "Gives an old picture again" }).click();
  await state.filter({ hasText: "wrong on purpose" }).waitFor();
  await open(page, "Live");
  await page.locator(".picture[data-same=true] .over", { hasText: /THE SAME PICTURE · \d+ times/ }).waitFor();
  await page.locator("#camera-frozen", { hasText: "unplug the camera" }).waitFor();
  await page.locator(".histogram[data-old=true] .tag.old").waitFor();
  await photograph(page, "frozen");
  await open(page, "Settings");
  await panel.locator("#faults-none").click();
  await open(page, "Live");
  await page.locator(".picture[data-same=false][data-state=fresh]").waitFor({ timeout: 20_000 });
  await page.locator("#camera-frozen").waitFor({ state: "detached" });
  await page.locator(".histogram[data-old=false]").waitFor();

  step("once there is a white frame, the meter shows what is read in every frame");
  await open(page, "Alignment");
  await page.locator("#kind").selectOption("spacing_watch");
  await page.locator(".start [name=duration_s]").fill("1");
  await page.locator("#start").click();
  const done = page.locator("#confirm:not([aria-disabled=true])");
  const show = (camera) =>
    page.evaluate(
      (body) =>
        fetch("/api/v1/simulation/faults", {
          method: "PUT",
          headers: { "content-type": "application/json" },
          body,
        }),
      JSON.stringify({ camera }),
    );
  await done.waitFor();
  await show({ picture: "dark" });
  await done.click();
  await page
    .locator(".turn .notice.wrong", { hasText: "Once more: The white frame cannot be used" })
    .waitFor();
  assert.equal(await page.locator(".steps li[data-state=repeated]").count(), 1);
  await photograph(page, "once-more");
  await show({ frozen: true });
  await done.click();
  await page.locator("header", { hasText: "gives an old picture again" }).waitFor();
  await page.locator(".turn.operator").waitFor();
  await show({});
  await done.click();
  await until(async () => {
    if (await done.isVisible()) await done.click();
    return page.locator(".job .outcome.succeeded").count();
  }, "the watch does not end");
  const meter = other.locator(".meter");
  const live = other.locator(".meter[data-state=measured][data-old=false]");
  await live.waitFor({ timeout: 20_000 });
  await other.locator(".meter .pace", { hasText: /^\d+ \/s · mean of \d+$/ }).waitFor();
  await other.evaluate(watchFigure);
  const rate = await until(async () => {
    const times = await other.evaluate((last) => globalThis.figures.slice(-last), FIGURES);
    const hz = (1000 * (times.length - 1)) / (times.at(-1) - times[0]);
    return times.length === FIGURES && hz >= LEAST_HZ && hz;
  }, `fewer than ${LEAST_HZ} figures a second are painted`);
  console.log(`  ${rate.toFixed(1)} figures a second`);
  // Until a frame has been measured in whole again it may be of two boards, and why it could not be is a long story.
  await live.and(other.locator(":not([data-direction=doubted])")).waitFor();
  const height = async () => Math.round((await meter.boundingBox()).height);
  const high = await height();
  const then = await meter.innerText();

  step("a spacing that is lost is said to be, in the place of the figure, until it is found again");
  await open(page, "Settings");
  await camera.getByRole("button", { name: "torn", exact: true }).click();
  await other
    .locator(".meter[data-state=lost] #difference", { hasText: "LOST" })
    .waitFor({ timeout: 20_000 });
  await meter.locator(".advice small", { hasText: /\w/ }).waitFor();
  assert.doesNotMatch(await meter.innerText(), /IN FOCUS|On target|slightly|Move/);
  assert.equal(await meter.locator("#spacing, .pointer").count(), 0, "a spacing is shown that is lost");
  assert.equal(await height(), high, `the meter jumps where the spacing is lost: ${then}`);
  await accessible(other);
  await photograph(other, "spacing-lost");
  await darken(other, "spacing-lost");
  await panel.locator("#faults-none").click();
  // A torn frame steps as two boards do: until one is measured in whole there is no figure.
  await live.locator("#spacing").waitFor({ timeout: 20_000 });

  step("where a frame cannot be measured, the last figure is shown as old, and why");
  const region = other.locator("#region");
  await other.locator(".picture").getByRole("button", { name: "Region" }).click();
  await region.locator("[data-old=false] > span", { hasText: /^spacing/ }).waitFor({ timeout: 20_000 });
  await camera.getByRole("button", { name: "dark", exact: true }).click();
  const refused = other.locator(".meter[data-state=refused][data-old=true]");
  await refused
    .locator(".advice", { hasText: /cannot be measured: .*grey levels/ })
    .waitFor({ timeout: 20_000 });
  await refused.locator(".tag.old", { hasText: /^OLD · \d+ s$/ }).waitFor();
  assert.match(await other.locator("#spacing").innerText(), /^\d+\.\d{4}$/);
  await region.locator("[data-old=true]", { hasText: /^OLD[^]*spacing/ }).waitFor();
  assert.equal(await height(), high, "the meter jumps where a frame cannot be measured");
  await photograph(other, "frame-refused");
  await panel.locator("#faults-none").click();
  await live.waitFor({ timeout: 20_000 });
  await region.locator("[data-old=false] > span", { hasText: /^spacing/ }).waitFor({ timeout: 20_000 });
  assert.equal(await region.locator(".tag.old").count(), 0);

  step("a reading that is taken while an axis moves says so");
  await open(page, "Live");
  await page.getByRole("button", { name: "Home the focus axis" }).click();
  await other.locator(".meter-tags .tag", { hasText: "an axis moves" }).waitFor({ timeout: 20_000 });
  assert.deepEqual(own(), []);
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  bench.remove();
}

/** In the page: when the spacing of another frame was painted, ms. At rest its digits seldom change. */
function watchFigure() {
  globalThis.figures = [];
  let shown = null;
  const look = (now) => {
    const frame = document.querySelector("#spacing")?.dataset.capturedAt ?? null;
    if (frame !== null && frame !== shown) globalThis.figures.push(now);
    shown = frame;
    requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
}
