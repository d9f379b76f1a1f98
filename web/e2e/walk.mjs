// Every view in one language, to be looked at: screenshots at each width in both themes, all that does not fit, and all that
// keeps somebody out. A walk of some minutes, by hand rather than with the other tests, after words or layout have changed.
// LANGUAGE is the page's (en unless given, or de). PAGE names a page served elsewhere (`PLENALIGN=… npm run dev`), with DAEMON
// as its daemon.

import assert from "node:assert/strict";
import { accessible, browse, faults, fits, folder, shots, start, step } from "./harness.mjs";
import { drawn, until } from "./until.mjs";

const place = folder(`
[sensor]
width_px = 560
height_px = 560

[bench.simulation]
rays = 4
preview_rays = 1
preview_rate_hz = 5.0
operator_confirms = false
`);
const language = process.env.LANGUAGE ?? "en";
const WIDTHS = [360, 1280, 2560];
const THEMES = ["light", "dark"];
const OVER = ".job .outcome:is(.converged, .succeeded, .not_converged, .failed, .cancelled)";
const daemon = start(place, process.env.DAEMON);
const browser = await browse();
const wrong = [];

try {
  const address = process.env.PAGE ?? (await daemon.address());
  if (process.env.PAGE) await daemon.address();
  const context = await browser.newContext({
    locale: `${language}-AT`,
    viewport: { width: 1280, height: 900 },
  });
  const page = await context.newPage();
  const own = faults(page);
  await page.goto(address);

  step("live");
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  assert.equal(await page.locator("html").getAttribute("lang"), language);
  await look(page, "name-asked");
  await page.locator("#your-name").fill("Ada");
  await page.locator("#your-name").press("Enter");
  await page.locator("#stop").click();
  await page.locator("#reset").click();
  await look(page, "stopped");
  await page.locator("#why").fill("cable clear");
  await page.locator("#reset-now").click();
  await page.locator(".stopped").waitFor({ state: "detached" });
  await page.locator(".lease button").click();
  await page.locator(".lease[data-lease=mine]").waitFor();
  await page.locator(".shell .toggle").nth(1).click();
  await look(page, "live");

  step("settings");
  await go(page, "settings");
  await page.locator(".configuration").waitFor();
  for (const details of await page.locator(".configuration > details > summary").all()) await details.click();
  await page.locator("#audit summary").click();
  await page.locator(".make-token input").fill("Vera");
  await page.locator(".make-token button[type=submit]").click();
  await page.locator(".tokens .ask").waitFor();
  await page.locator(".stop-key button").click();
  await look(page, "settings");
  await page.keyboard.press("Escape");
  const documented = await context.newPage();
  await documented.goto(new URL(await page.locator(".records a").getAttribute("href"), address).href);
  await documented.locator("#contract .opblock").first().waitFor();
  await look(documented, "api", async (page, width) => page.setViewportSize({ width, height: 800 }));
  await documented.locator(".opblock-summary-control").first().click();
  await documented.locator(".opblock-body").first().waitFor();
  await look(documented, "api-open", async (page, width) => page.setViewportSize({ width, height: 800 }));
  await documented.close();
  const slip = page.locator(".faults fieldset").nth(2).locator("input").first();
  await slip.fill("1.2.3");
  await slip.blur();
  await page.locator(".faults .fault").first().waitFor();
  await look(page, "faults");

  step("design");
  await go(page, "design");
  await page.locator(".figures").waitFor();
  await page.locator(".compare-with .toggle").nth(2).click();
  await page.locator("fieldset .choice .toggle").last().click();
  await look(page, "design");
  await page.locator("#draft-mla\\.pitch_mm").fill("-1");
  await page.locator(".notice.wrong").waitFor();
  await look(page, "design-wrong");

  step("each kind of job");
  await go(page, "alignment");
  for (const kind of await page.locator("#kind option").evaluateAll((all) => all.map(({ value }) => value))) {
    await page.locator("#kind").selectOption(kind);
    // A sweep is not offered before homing, nor the shell step before an air step.
    if (!["focus_sweep", "shell_only"].includes(kind)) await page.locator("#start").click({ trial: true });
    if (kind === "clarity_only") {
      await page.locator(".start input").first().fill("1,2,3");
      await page.locator("#start").click();
    }
    await look(page, `start-${kind}`);
  }
  await page.locator("#kind").selectOption("joint_alignment");
  await page.locator("#plan summary").click();
  await look(page, "plan");

  step("an alignment");
  await page.locator("#start").click();
  for (let asked = 0; ;) {
    await page.locator(`#confirm, ${OVER}`).first().waitFor({ timeout: 240_000 });
    if (await page.locator(OVER).count()) break;
    const number = await page.locator(".turn h3").innerText();
    asked += 1;
    await go(page, "live");
    await look(page, `turn-${asked}-live`);
    await go(page, "alignment");
    await look(page, `turn-${asked}`);
    const again = page.locator(".steps .again");
    if (asked === 2) {
      await again.first().click();
      await page.locator(".steps .ask").waitFor();
      await look(page, "again");
      await page.locator(".steps .ask button").last().click();
      await page.locator(".steps .ask").waitFor({ state: "detached" });
    }
    await page.locator("#confirm[aria-disabled=false]").click();
    await until(
      async () => (await page.locator(`.turn h3:text-is("${number}")`).count()) === 0,
      `${number} goes on`,
    );
  }
  assert.equal(
    await page.locator(".job .outcome.converged").count(),
    1,
    await page.locator(".job").innerText(),
  );
  await page.locator(".meter[data-old=false]").waitFor({ timeout: 20_000 });
  await page.locator(".iterations details summary").click();
  await page.locator(".result details summary").click();
  await page.locator(".steps-taken summary").click();
  await look(page, "result");
  await page.goto(new URL("#/meter", address).href);
  await page.locator(".meter-alone[data-old=false]").waitFor({ timeout: 20_000 });
  await look(page, "meter-alone");
  await go(page, "live");
  await page.locator(".meter[data-old=false]").waitFor({ timeout: 20_000 });
  for (const overlay of await page.locator(".tools .choice").nth(1).locator("button").all())
    await overlay.click();
  await page.locator(".legend").first().waitFor();
  await look(page, "measured");
  await page.locator(".manual input").first().fill("0");
  await page.locator(".manual input").first().press("Enter");
  await page.locator(".axis .ask").waitFor();
  await page.locator(".tools .choice").first().locator("button").nth(2).click();
  await page.locator(".legend .far").waitFor({ timeout: 60_000 });
  await look(page, "depth");

  await page.locator(".tools .choice").first().locator("button").first().click();

  step("what is measured in the picture");
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  for (const mark of [0, 1]) await page.locator(".tools .choice").nth(2).locator("button").nth(mark).click();
  await look(page, "measuring");

  step("two boards in view");
  await go(page, "settings");
  const second = page.locator(".faults fieldset").nth(1).locator("input").nth(3);
  await second.fill("250");
  await second.blur();
  await page.locator("#faults-none:enabled").waitFor();
  await go(page, "live");
  await page.locator(".meter[data-direction=two_boards]").waitFor({ timeout: 20_000 });
  await look(page, "two-boards");
  await go(page, "settings");
  await page.locator("#faults-none").click();
  await page.locator("#faults-none:disabled").waitFor();
  await go(page, "live");
  await page.locator(".meter:not([data-direction=two_boards])").waitFor({ timeout: 20_000 });

  step("a sweep through focus");
  await go(page, "alignment");
  await page.locator("#kind").selectOption("focus_sweep");
  const { axes } = await (await fetch(new URL("/api/v1/bench", address))).json();
  const middle = axes.find(({ axis }) => axis === "focus").position_mm;
  await page.locator(".start [name=from_mm]").fill((middle - 0.3).toFixed(3));
  await page.locator(".start [name=to_mm]").fill((middle + 0.3).toFixed(3));
  await page.locator(".start [name=steps]").fill("7");
  await page.locator("#start").click();
  await page.locator(".job[data-state=running]").waitFor();
  await page.locator(OVER).waitFor({ timeout: 60_000 });
  await look(page, "through-focus");
  await page.locator("#kind").selectOption("joint_alignment");

  step("history");
  await go(page, "history");
  await page.locator("table.jobs .toggle").first().click();
  await page.locator(".compare li").first().waitFor();
  await look(page, "history");

  step("a job that is cancelled, in another's eyes, and a lost connection");
  await go(page, "alignment");
  await page.locator("#start").click();
  await page.locator("#confirm").waitFor({ timeout: 60_000 });
  const other = await context.newPage();
  await other.goto(address);
  await go(other, "alignment");
  await other.locator(".hand-on summary").click();
  await look(other, "other");
  await other.locator(".lease button").click();
  await look(other, "take-over");
  await page.locator("#cancel").click();
  await look(page, "cancel");
  await page.locator(".turn .ask .primary[aria-disabled=false]").click();
  await page.locator(".way-on").waitFor();
  await look(page, "cancelled");
  assert.deepEqual(own(), []);
  daemon.process.kill("SIGSTOP");
  await page.locator(".link[data-link=lost]").waitFor({ timeout: 20_000 });
  await page.locator("#stop").click();
  await page.locator(".stop-failed").waitFor({ timeout: 10_000 });
  await go(page, "live");
  await look(page, "lost");
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  place.remove();
}
assert.deepEqual(wrong, []);

/** Opens one of the page's pages by its address, which has no language. */
async function go(page, name) {
  await page.locator(`nav a[href="#/${name}"]`).click();
  await page.locator(`main[data-page=${name}]`).waitFor();
}

/** Photographs the page at each width in both themes, and notes what does not fit and what is not accessible. */
async function look(page, name, within = fits) {
  const before = page.viewportSize();
  const note = async (where, check) => {
    try {
      await check();
    } catch (error) {
      wrong.push(`${name} ${where}`);
      console.log(`${wrong.at(-1)}: ${error.message}`);
    }
  };
  for (const theme of THEMES) {
    await page.emulateMedia({ colorScheme: theme });
    for (const width of WIDTHS) {
      await page.evaluate(() => scrollTo(0, 0));
      const where = `${width}-${theme}`;
      await note(where, () => within(page, width));
      await note(where, async () => assert.deepEqual(await page.evaluate(spilt), [], "words stick out"));
      await page.screenshot({ path: `${shots}/${language}-${name}-${where}.png`, fullPage: true });
    }
    await page.setViewportSize(before);
    await note(theme, () => accessible(page));
  }
  await page.emulateMedia({ colorScheme: "light" });
}

/** Words that stick out of what they are in; runs in the page. */
function spilt() {
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const out = [];
  while (texts.nextNode()) {
    const { parentElement: within } = texts.currentNode;
    if (
      texts.currentNode.textContent.trim() === "" ||
      within.closest(".table, .unseen, .skip, .bar h1, svg, select, .uplot, .read-off")
    )
      continue;
    const range = document.createRange();
    range.selectNodeContents(texts.currentNode);
    const box = range.getBoundingClientRect();
    const around =
      within.closest("dt, dd, button, .choice, label, .row, .card, .bar > *") ?? document.documentElement;
    const limit = Math.min(around.getBoundingClientRect().right, window.innerWidth);
    if (box.width > 0 && box.right > limit + 1) out.push(texts.currentNode.textContent.trim());
  }
  return out;
}
