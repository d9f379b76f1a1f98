// End to end: an alignment by double clicks and one by keys, STOP in mid-run, a daemon that dies and comes back.

import assert from "node:assert/strict";
import { chooseUnit, lengthsIn, printed } from "./checks.mjs";
import {
  accessible,
  browse,
  darken,
  faults,
  folder,
  open,
  photograph,
  resetStop,
  shots,
  start,
  step,
} from "./harness.mjs";
import { chartsBack, explained, measured, meterAlone, twoBoards } from "./looking.mjs";
import { until } from "./until.mjs";

const ALIGNMENT_MS = 240_000;
const OVER = ".job .outcome:is(.converged, .succeeded, .not_converged, .failed, .cancelled)";
// A small sensor, so that it is quick; the operator is this script.
const place = folder(`
[sensor]
width_px = 560
height_px = 560

[bench.simulation]
rays = 16
preview_rays = 1
preview_rate_hz = 5.0
operator_confirms = false
`);

const started = Date.now();
let daemon = start(place);
const browser = await browse();

try {
  const address = await daemon.address();
  const page = await browser.newPage({ viewport: { width: 1024, height: 900 } });
  const own = faults(page);
  await page.goto(address);

  step("the simulated bench says so");
  await page.locator(".simulated").waitFor();
  assert.match(await page.title(), /SIMULATED/);

  step("a live picture comes, and says how old it is");
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  assert.match(await page.locator(".picture p.facts").first().innerText(), /frame \d+ · \d+ ms old/);
  await photograph(page, "idle");
  await page.locator("#your-name").fill("Ada");
  await page.locator("#your-name").press("Enter");

  step("STOP latches, refuses a start, and is reset");
  await page.locator("#stop").click();
  await page.locator("#reset").waitFor();
  await open(page, "Alignment");
  assert(await page.locator("#start").isDisabled());

  step("what stands at the top of the page leaves a phone room to see it");
  await page.setViewportSize({ width: 360, height: 640 });
  const header = await page.locator("header").boundingBox();
  assert(header.height <= 0.46 * 640, `the header takes ${header.height} of 640 px`);
  await page.setViewportSize({ width: 1024, height: 900 });
  await resetStop(page, "the bench is clear");

  step("before it starts it says what it will ask for");
  const plan = page.locator("#plan");
  await plan.locator("summary", { hasText: "You are asked 4 times" }).click();
  const asked = await plan.locator("ol li").allInnerTexts();
  assert.match(asked[1], /Triple-level board in air: 159\.2, 167\.2, 175\.2 mm/);
  await plan.getByText(/by the picture and the axes alone/).waitFor();
  await photograph(page, "start");

  step("what cannot be aligned cannot be started, and says why");
  await page.route("**/api/v1/plan", async (route) => {
    const response = await route.fetch();
    const whole = await response.json();
    const obstacle = {
      key: "bench.focus.high_limit_mm",
      value: "2",
      needed: "at least 2.7",
      why: "too short",
    };
    await route.fulfill({ response, json: { ...whole, possible: false, obstacles: [obstacle] } });
  });
  await page.locator("#kind").selectOption("homing");
  await page.locator("#kind").selectOption("joint_alignment");
  await plan.getByText("is 2, and would have to be at least 2.7: too short").waitFor();
  assert(await page.locator("#start").isDisabled());
  await page.unroute("**/api/v1/plan");
  await page.locator("#kind").selectOption("homing");
  await page.locator("#kind").selectOption("joint_alignment");
  await plan.locator("summary").waitFor();

  step("what gets the focus on a phone is not under STOP");
  await page.setViewportSize({ width: 360, height: 740 });
  await page.locator("#start").focus();
  const [button, stop] = [
    await page.locator("#start").boundingBox(),
    await page.locator("#stop").boundingBox(),
  ];
  assert(button.y + button.height <= stop.y, "STOP hides Start");
  await page.setViewportSize({ width: 1024, height: 900 });

  step("STOP in mid-run ends the job and stops the axes");
  await page.locator("#start").click();
  await page.locator("#cancel").waitFor();
  await open(page, "Live");
  const moving = page.locator(".axes .tag", { hasText: "moving" }).first();
  await moving.waitFor({ timeout: 20_000 });
  const exposure = page.locator(".camera [data-control=exposure] input");
  await page.locator("#camera-barred", { hasText: "A job is under way" }).waitFor();
  assert(await exposure.isDisabled(), "the camera can be set otherwise in a job");
  await page.locator("#stop").click();
  await page.locator(".strip .outcome.cancelled").waitFor({ timeout: 15_000 });
  await moving.waitFor({ state: "detached", timeout: 15_000 });
  await page.locator(".stopped", { hasText: "Focus axis: stopped; e axis: stopped." }).waitFor();
  await page.locator(".strip .way-on", { hasText: "reset the stop first" }).waitFor();
  await photograph(page, "stopped");
  await open(page, "Alignment");
  const wayOn = page.locator(".job .way-on");
  await wayOn.getByText("No air step holds").waitFor();
  await wayOn.getByText("reset the stop first").waitFor();
  assert(await wayOn.locator("button").isDisabled(), "a job can be started on a bench that is stopped");
  await resetStop(page, "the bench is clear");
  assert.deepEqual(await wayOn.locator("button").allInnerTexts(), ["Begin again: Joint alignment"]);

  step("who double-clicks everything cancels nothing, answers nothing that was not asked, and converges");
  await open(page, "Alignment");
  const answers = confirmations(page);
  // What people type may have no blank in it.
  await page.locator("#note").fill(`<b>${"first_light_".repeat(15)}`);
  await page.locator("#start").dblclick();
  await page.locator("#confirm").waitFor({ timeout: 60_000 });
  await page.locator("#cancel").dblclick();
  await page.locator(".turn .ask", { hasText: "Cancel the job?" }).waitFor();
  await page.getByRole("button", { name: "Let it go on" }).dblclick();
  await page.locator(".turn .ask").waitFor({ state: "detached" });
  await withoutDiskOrCamera(page, address);
  const prompts = await answer(page, (confirm) => confirm.dblclick(), {
    meanwhile: (prompt) => (prompt === 2 ? whiteFrameAgain(page) : undefined),
  });
  await page.locator(".job .outcome.converged").waitFor({ timeout: 60_000 });
  assert.equal(answers(), prompts);
  assert.equal(await page.locator("header .problem").count(), 0);

  step("its steps are told, with what each took, and that one was done again");
  await page.locator(".steps-taken summary").click();
  const taken = page.locator(".steps li");
  const states = await taken.evaluateAll((all) => all.map(({ dataset }) => dataset.state));
  assert.deepEqual(states, ["done", "repeated", "repeated", "done", "done", "done", "done"]);
  assert.match(await taken.nth(3).innerText(), /no\. 3.*step 1 once more.*operator \d+ s.*bench \d+ s/s);
  await accessible(page);
  await photograph(page, "steps");
  await darken(page, "steps");

  step("an alignment runs to its end by the keyboard alone, through a reload");
  await reach(page, "#kind");
  await page.keyboard.type("Joint");
  await reach(page, "#note");
  await page.keyboard.type("by keys");
  await page.keyboard.press("Enter");
  await page.locator("#cancel").waitFor();
  await handOver(page);
  const keyed = confirmations(page);
  const { rows, asked: keys } = await seeThrough(page);
  assert.equal(keyed(), keys, "a prompt was answered twice, or before it could be read");
  const ended = await page.locator(".job").innerText();
  assert.equal(await page.locator(".job .outcome").textContent(), "Converged", ended);
  assert(rows >= 4, `only ${rows} iterations are shown`);
  await page.locator(".result").waitFor();
  await page.locator(".job:focus").waitFor();
  assert.doesNotMatch(await page.locator("body").innerText(), /NaN|undefined|null\b|Infinity/);
  await page.locator(".meter .tag.good").waitFor({ timeout: 10_000 });
  // What the job has accepted, the meter does not send anybody away from.
  await page.locator(".meter[data-direction=there] .advice", { hasText: "no move is called for" }).waitFor();
  // It is measured on while this page alone is looked at.
  const read = async () => Number(await page.locator("#spacing").getAttribute("data-captured-at"));
  const first = await read();
  await until(async () => (await read()) > first + 1500, "it is measured no further");
  await page.locator(".meter[data-old=false][data-direction=there]").waitFor({ timeout: 4000 });
  await photograph(page, "converged");
  await darken(page, "converged");

  step("its lengths are in the unit chosen, on the screen and on paper");
  await printed(page, "report");
  await lengthsIn(page, "mm");
  await chooseUnit(page, "µm");
  for (const name of ["Live", "Alignment"]) {
    await open(page, name);
    await page.locator(".meter-scale").waitFor();
    await lengthsIn(page, "µm");
  }
  const deltaV = /Δv\s*(\d{4}\.\d) ± (\d\d\.\d) µm, target (\d{4}\.\d) µm/;
  await page.locator(".result", { hasText: deltaV }).waitFor();
  const [, found, sigma, target] = (await page.locator(".result").innerText()).match(deltaV).map(Number);
  assert(Math.abs(found - target) < 3 * sigma, `Δv ${found} ± ${sigma} µm for ${target} µm`);
  // That of where e is held: 2205 µm at e = 0, and 18 µm less a millimetre further away.
  assert(target > 2185 && target < 2210, `Δv is to be ${target} µm`);
  const verdict = /Δv = (\d{4}\.\d) ± (\d+\.\d) µm/;
  const [, concluded, stated] = (await page.locator(".result .verdict").innerText())
    .match(verdict)
    .map(Number);
  assert.deepEqual([concluded, stated], [found, sigma], "the verdict is in another unit than the figures");
  await page.locator(".iterations th", { hasText: "Focus axis, µm" }).waitFor();
  await photograph(page, "micrometres");
  await chooseUnit(page, "mm");
  await open(page, "Alignment");

  step("its report can be fetched");
  for (const link of await page.locator(".job .downloads a").all()) {
    const href = await link.getAttribute("href");
    const answer = await page.request.get(new URL(href, address).href);
    assert.equal(answer.status(), 200, href);
    assert((await answer.body()).length > 500, href);
  }

  step("the history has it, finds it, and shows it again");
  await open(page, "History");
  await page.locator("table.jobs tbody tr").nth(1).waitFor();
  await page.locator("#state").selectOption("converged");
  await page.waitForFunction(() => document.querySelectorAll("table.jobs tbody tr").length === 2);
  await page.locator("#state").selectOption("");
  await page.waitForFunction(() => document.querySelectorAll("table.jobs tbody tr").length >= 2);
  for (const row of [0, 1]) await page.locator("table.jobs .toggle").nth(row).click();
  await page.locator(".compare li").nth(1).waitFor();
  await photograph(page, "history");
  await darken(page, "history");
  await printed(page, "history");
  await page.locator("table.jobs a").first().click();
  await page.locator("#start").waitFor();
  assert.equal(await page.locator(".earlier").count(), 0, "the newest job is one of earlier on");
  assert.equal(await page.locator(".iterations tbody tr").count(), rows);
  await open(page, "History");
  await page.locator("table.jobs tbody tr").nth(1).locator("a").first().click();
  await page.locator(".earlier").waitFor();
  await page.locator(".iterations tbody tr").first().waitFor();
  assert.equal(await page.locator("#start").count(), 0, "a job is started beside one of earlier on");
  await page.locator(".earlier a").click();
  await page.locator(".earlier").waitFor({ state: "detached" });
  await page.goBack();
  await page.locator(".earlier").waitFor();
  const earlier = new URL(page.url()).hash;
  await page.locator(".earlier a").click();
  await page.locator(".earlier").waitFor({ state: "detached" });
  // Whoever comes late by the link to a job's prompts sees what became of that job.
  await page.evaluate((hash) => (location.hash = hash), `${earlier}/confirm_${"0".repeat(64)}`);
  await page.locator(".earlier").waitFor();
  assert.equal(new URL(page.url()).hash, earlier);
  await page.locator(".earlier a").click();

  step("a reload shows the same result, and the live picture again");
  await page.reload();
  await page.locator(".job .outcome.converged").waitFor({ timeout: 10_000 });
  assert.equal(await page.locator(".iterations tbody tr").count(), rows);
  await open(page, "Live");
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  await until(async () => (await spread(page)) > 10, "the picture is blank");

  step("the picture can be the view that is made of the frame, or its depth");
  const scale = () => page.locator(".tools output").textContent();
  const whole = await scale();
  const grid = page.getByRole("button", { name: "Grid", exact: true });
  assert((await coloured(page)) < 0.001, "a raw frame is grey");
  await page.getByRole("button", { name: "Central view" }).click();
  // Its pixels are fewer than the frame's, and so shown larger.
  await page.waitForFunction((raw) => document.querySelector(".tools output").textContent !== raw, whole, {
    timeout: 60_000,
  });
  assert.match(await page.locator("#live").getAttribute("aria-label"), /^Central view/);
  assert(await grid.isDisabled(), "an overlay of raw pixels is offered over a view");
  await until(async () => (await spread(page)) > 5, "the view is blank");
  assert((await coloured(page)) < 0.001, "a view is grey");
  await photograph(page, "central");
  await page.getByRole("button", { name: "Depth map" }).click();
  await page.locator(".legend", { hasText: /far \d+ mm.*near \d+ mm/ }).waitFor();
  await until(async () => (await coloured(page)) > 0.05, "no depth map is shown");
  await neverStale(page, 2);
  await photograph(page, "depth");
  await page.getByRole("button", { name: "Raw frame" }).click();
  await until(
    async () => (await coloured(page)) < 0.001 && (await scale()) === whole,
    "the raw frame is not back",
  );
  assert(await grid.isEnabled());

  step("the meter, the clarity and the axes are charted, and the live page can be printed");
  assert.equal(await page.locator(".charts .chart canvas").count(), 3);
  await until(
    async () => (await page.locator(".charts .chart-none").count()) === 0,
    "spacing or clarity is not charted",
  );
  await printed(page, "live");

  step("off the band that a job accepts, the meter says which way to go");
  const tone = page.getByRole("button", { name: "Tone", exact: true });
  assert.doesNotMatch(await page.title(), /Your turn/);
  await page.keyboard.press("t");
  await page.locator(".meter [aria-pressed=true]", { hasText: "Tone" }).waitFor();
  await tone.click();
  await page.locator(".meter [aria-pressed=false]", { hasText: "Tone" }).waitFor();
  await page.locator(".meter[data-old=false][data-direction=there]").waitFor({ timeout: 20_000 });
  const field = page.getByLabel("Move the e axis to, mm");
  const there = await position(address, "e");
  await field.fill((there + 0.9).toFixed(2));
  await field.press("Enter");
  await page.locator(".meter[data-old=false][data-direction=smaller]").waitFor({ timeout: 20_000 });
  await page
    .locator(".meter .advice", { hasText: /Move the camera \d\.\d\d mm towards the shell/ })
    .waitFor();
  const moves = page.locator(".axes .tag", { hasText: "moving" });
  await until(async () => (await moves.count()) === 0, "the axis does not come to rest");

  step("and tells nothing to be moved while nothing can be");
  await page.locator("#stop").click();
  await page.locator(".meter .advice", { hasText: "Nothing can be moved: the bench is stopped" }).waitFor();
  assert.doesNotMatch(await page.locator(".meter .advice").innerText(), /Move/);
  await photograph(page, "advice-stopped");
  await resetStop(page, "it was a test");
  await field.fill(there.toFixed(3));
  await field.press("Enter");
  await page.locator(".meter[data-old=false][data-direction=there]").waitFor({ timeout: 20_000 });

  step("the meter by itself fills a phone and a wall");
  await meterAlone(page);

  step("while nobody has said whether the shell is on, there is no target to be on");
  const shell = page.locator(".shell");
  // A question that another choice has overtaken is gone.
  await shell.getByRole("button", { name: "off", exact: true }).click();
  await shell.getByRole("button", { name: "It is off" }).waitFor();
  await shell.getByRole("button", { name: "unknown", exact: true }).click();
  await shell.getByRole("button", { name: "It is off" }).waitFor({ state: "detached" });
  const unsaid = page.locator(".meter[data-old=false][data-direction=unsaid]");
  await unsaid.locator(".advice", { hasText: "Nobody has said whether the shell is on" }).waitFor();
  assert.equal(await unsaid.locator(".tag.good").count(), 0, "in focus, by a target that may be another");
  await photograph(page, "shell-unknown");
  await shell.getByRole("button", { name: "on", exact: true }).click();
  await page.locator(".meter[data-old=false][data-direction=there]").waitFor({ timeout: 20_000 });

  step("two boards in view are said to be two, and order nothing");
  await twoBoards(page);

  step("charts are zoomed by wheel, drag, buttons and keys, back to when the page was opened");
  await chartsBack(page);

  step("a region and a distance are measured in the picture, and the picture and the raw frame are kept");
  await measured(page);

  step("words of the field are explained where they stand, in the glossary's words");
  await explained(page);

  step(
    "an alignment runs to its end by single clicks, and says how long it takes by what the last ones took",
  );
  await open(page, "Alignment");
  await page.locator("#start").click();
  await page
    .locator(".progress", { hasText: /about \d+ (s|min) left, not counting the operator’s part/ })
    .waitFor();
  assert((await answer(page, (confirm) => confirm.click(), { timed: true })) >= 3);
  await page.locator(".job .outcome.converged").waitFor();

  step("the history goes on with the job that is under way");
  await page.locator("#start").click();
  await page.locator(".turn").waitFor();
  await open(page, "History");
  await page
    .locator("table.jobs tbody tr", { hasText: "Waiting for the operator" })
    .first()
    .waitFor({ timeout: 30_000 });
  await open(page, "Alignment");

  step("a job that ended early says what still holds");
  await page.locator("#confirm").waitFor({ timeout: 30_000 });
  await cancel(page);
  await wayOn.getByText("The air step still holds").waitFor();
  await accessible(page);
  await wayOn.getByRole("button", { name: "Go on: Shell step only" }).click();
  await page.locator(".operator", { hasText: "Mount the shell" }).waitFor({ timeout: 30_000 });
  await answer(page, (confirm) => confirm.click(), { timed: true });
  await page.locator(".job .outcome.converged").waitFor();

  step("a sweep through focus is two curves, with best focus, on the page and in the report");
  await page.locator("#kind").selectOption("focus_sweep");
  const middle = await position(address, "focus");
  await page.locator(".start [name=from_mm]").fill((middle - 0.3).toFixed(3));
  await page.locator(".start [name=to_mm]").fill((middle + 0.3).toFixed(3));
  await page.locator(".start [name=steps]").fill("7");
  await page.locator("#start").click();
  await page.locator(".job .outcome.succeeded").waitFor({ timeout: 60_000 });
  const best = /Best focus by the curve\s*(\d\.\d{4}) ± (0\.\d{4}) mm/;
  const [, at, within] = (await page.locator(".result").innerText()).match(best).map(Number);
  assert(
    Math.abs(at - middle) < 0.01 && within < 0.01,
    `best focus at ${at} ± ${within}, ${middle} converged`,
  );
  await page.locator(".through-focus", { hasText: /EOG greatest: \d\.\d{4} ± / }).waitFor();
  assert.equal(await page.locator(".iterations .chart canvas").count(), 2);
  const swept = await page.locator(".job .downloads a", { hasText: "Report" }).getAttribute("href");
  const paper = await (await page.request.get(new URL(swept, address).href)).text();
  assert.match(
    paper,
    /<h2>Through focus<\/h2>[^]*Spacing; best focus at \d\.\d{4} ±[^]*EOG of the central view/,
  );
  await accessible(page);
  await photograph(page, "through-focus");
  await darken(page, "through-focus");
  await open(page, "Live");

  step("overlays are drawn over it, and it is seen down to single pixels");
  assert.equal(await painted(page), 0, "something is drawn over the picture unasked");
  for (const name of ["Grid", "Spacing error"]) {
    await page.getByRole("button", { name, exact: true }).click();
  }
  await until(async () => (await painted(page)) > 0, "nothing is drawn over the picture");
  await page.locator(".legend", { hasText: /lines every [\d.]+ px|no tilt or curvature/ }).waitFor();
  await photograph(page, "overlays");
  await darken(page, "overlays");
  for (let i = 0; i < 6; i += 1) await page.getByRole("button", { name: "Zoom in" }).click();
  await until(async () => (await scale()) !== whole, "nothing is zoomed");
  await page.locator("#live").hover();
  assert.match(await page.locator(".probe").innerText(), /pixel \d+, \d+ · grey \d+/);
  await photograph(page, "zoomed");
  await page.getByRole("button", { name: "Whole" }).click();

  step(
    "set to another exposure, the camera has no white frame, and the meter reads nothing until there is one",
  );
  await page.locator(".camera", { hasText: "A change drops the white frame" }).waitFor();
  await exposure.fill("9");
  await exposure.press("Enter");
  await page.locator(".meter", { hasText: "measured by a white frame, and there is none" }).waitFor();
  await until(async () => (await painted(page)) === 0, "a map is drawn over what it is not of");
  assert.equal(await page.locator("#difference").count(), 0, "what was read with another exposure is shown");
  assert.equal(await page.locator(".camera", { hasText: "A change drops the white frame" }).count(), 0);

  step("a daemon that is killed is seen to be gone, in the midst of a job");
  await open(page, "Alignment");
  // What somebody was about to start is still there.
  assert.equal(await page.locator("#kind").inputValue(), "focus_sweep");
  await page.locator("#kind").selectOption("joint_alignment");
  await page.locator("#note").fill("cut short");
  await page.locator("#start").click();
  await page.locator(".turn").waitFor();
  const beside = await browser.newPage();
  await beside.goto(`${address}#/alignment`);
  await beside.locator(".turn").focus();
  await open(page, "Live");
  await page.locator(".picture").getByRole("button", { name: "Region" }).click();
  await page.locator("#region [data-old=false]", { hasText: "grey" }).waitFor();
  daemon.process.kill("SIGKILL");
  await page.locator(".link[data-link=lost]").waitFor({ timeout: 10_000 });
  assert.equal(await page.locator(".picture").getAttribute("data-state"), "stale");
  await page.locator(".picture .over", { hasText: "STALE" }).waitFor();
  await page.locator(".retry", { hasText: /Trying again in \d s|Trying again…/ }).waitFor();
  await page.locator(".lease[data-lease=unclear]").waitFor();
  await page.locator("#region [data-old=true]", { hasText: /OLD[^]*grey/ }).waitFor();
  await photograph(page, "lost");

  step("a clock of the browser's computer that is set back makes nothing younger");
  const age = async () =>
    Number(/STALE · (\d+) s old/.exec(await page.locator(".picture .over").innerText())?.[1]);
  const before = await age();
  await page.evaluate(() => {
    const now = Date.now;
    Date.now = () => now() - 3_600_000;
  });
  await until(async () => (await age()) > before, "the picture grows no older");

  step("a stop that is not delivered is told, large");
  let undelivered = 0;
  page.on("requestfailed", (request) => {
    if (new URL(request.url()).pathname === "/api/v1/stop") undelivered += 1;
  });
  await page.locator("#stop").click();
  await page.locator(".stop-failed").waitFor({ timeout: 10_000 });
  await until(() => undelivered === 3, "the stop is not tried again");

  step("and is seen to be back, with nothing of the old run left");
  await open(page, "History");
  const listed = page.waitForResponse(
    (response) => response.ok() && new URL(response.url()).pathname === "/api/v1/jobs",
    { timeout: 40_000 },
  );
  await daemon.ended;
  daemon = start(place, new URL(address).host);
  await page
    .locator("#retry")
    .click({ timeout: 5000 })
    // It has tried by itself meanwhile, and is connected.
    .catch(() => {});
  await page.locator(".link").waitFor({ state: "detached", timeout: 20_000 });
  await page.locator(".stop-failed").waitFor({ state: "detached" });
  // Whatever the page asks by itself meanwhile, and whatever is looked at: that is not to be missed.
  await (await listed).finished();
  await open(page, "Live");
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 20_000 });
  await page.locator("#not-stopped", { hasText: "The bench is not stopped" }).waitFor();
  await page.locator("#not-stopped button").click();

  step("what was interrupted is shown, with the way on");
  await open(page, "Alignment");
  const cut = page.locator(".job[data-state=interrupted]", { hasText: "cut short" });
  await cut.getByText("the axes have to be homed again").waitFor({ timeout: 10_000 });
  // Whoever was at the keyboard there is at what became of it.
  await beside.locator(".job[data-state=interrupted]:focus").waitFor();
  await beside.close();
  await cut.locator(".way-on li", { hasText: "Whether the shell is on is not known" }).waitFor();
  await photograph(page, "interrupted");
  await accessible(page);
  await page.reload();
  await cut.locator("[data-way=again]").click();
  await page.locator(".job[data-state=running]", { hasText: "cut short" }).waitFor();
  daemon.process.kill("SIGTERM");
  assert.equal(await daemon.ended, 0, "the daemon's exit code after SIGTERM");

  assert.deepEqual(own(), []);
  const seconds = ((Date.now() - started) / 1000).toFixed(0);
  console.log(`end to end: converged in ${rows} iterations, ${seconds} s, screenshots in ${shots}/`);
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  place.remove();
}

/** While the disk is full, or the camera gone, a prompt takes no answer, as the job would end by it, and says so. */
async function withoutDiskOrCamera(page, address) {
  const faults = async (data) => {
    const answer = await page.request.put(new URL("/api/v1/simulation/faults", address).href, { data });
    assert.equal(answer.status(), 200, await answer.text());
  };
  await faults({ disk: { full: true } });
  await page.locator("#confirm[aria-disabled=true]").waitFor();
  await page.locator(".turn .fault", { hasText: "when the history can be written again" }).waitFor();
  await photograph(page, "disk-full");
  // One fault takes the place of the other.
  await faults({ camera: { unplugged: true } });
  await page
    .locator(".turn .fault", {
      hasText: "The camera gives no pictures: see to its cable and its power first.",
    })
    .waitFor();
  assert.equal(await page.locator("#confirm").getAttribute("aria-disabled"), "true");
  await faults({});
  await page.locator("#confirm:not([aria-disabled=true])").waitFor();
}

/** Has somebody else confirm the first prompt with a key made there, and the second by the link that the job's starter hands on. */
async function handOver(page) {
  step("somebody else sees the prompt, and cannot confirm it without the job's key");
  const heading = await page.locator(".operator h3").textContent({ timeout: 60_000 });
  const context = await browser.newContext({ viewport: { width: 1024, height: 900 } });
  const other = await context.newPage();
  const theirs = faults(other);
  await other.goto(new URL("#/alignment", page.url()).href);
  const theirTurn = heading.replace("Your turn", "The operator’s turn");
  await other.locator(".operator h3", { hasText: theirTurn }).waitFor();
  assert.match(await other.title(), /^● The operator’s turn/);
  await other.locator(".give-key", { hasText: /^Only .* confirms this/ }).waitFor();
  assert.equal(await other.locator("#confirm").count(), 0, "a viewer without a key is offered to confirm");
  assert.equal(await other.locator("#confirm-link").count(), 0);
  await other.locator("#confirm-key").fill("guess");
  await other.locator(".give-key button").click();
  await other.locator(".give-key .fault").waitFor();
  await photograph(other, "no-key");
  await accessible(other);
  await other.locator("#confirm-key").fill(`confirm_${"0".repeat(64)}`);
  await other.locator(".give-key button").click();
  await other.locator(".turn .fault", { hasText: "confirms nothing" }).waitFor();
  assert.equal(await other.locator("#confirm").count(), 0, "a key that is none is taken for one");

  step("whoever may make another key confirms from where they are, and that once the question is answered");
  await other.locator("#confirm-here").dblclick();
  await other.locator(".turn .ask", { hasText: "Confirm from here from now on?" }).waitFor();
  await photograph(other, "confirm-here");
  await accessible(other);
  assert.equal(await other.locator("#confirm").count(), 0, "it is confirmed by a question");
  await other.getByRole("button", { name: "Confirm from here", exact: true }).click();
  await other.locator("#confirm").dblclick();
  await page.locator(".operator h3", { hasText: heading }).waitFor({ state: "detached", timeout: 15_000 });
  const second = await page.locator(".operator h3").textContent({ timeout: 60_000 });
  await other.locator("#confirm").waitFor();
  await page.locator(".hand-on summary").click();
  await page.locator(".hand-on .fault", { hasText: "Another key has been made" }).waitFor();
  assert.equal(await page.locator("#confirm-link").count(), 0, "a link that is dead is handed on");
  await page.locator(".hand-on summary").click();

  step("where the prompt is not in sight the page says whose turn it is, and leads to it");
  await page.evaluate(() => (location.hash = "#/design"));
  await page.locator("header .call", { hasText: "Your turn" }).click();
  await page.locator("#confirm").waitFor();
  await page.locator("header .call").waitFor({ state: "detached" });

  step("the link with the key confirms it, and leaves no key in the address bar");
  await page.locator(".hand-on summary").click();
  await photograph(page, "hand-on");
  // The key that the link had is dead since another was made.
  await page.locator("#renew-key").click();
  await other.locator(".turn .fault", { hasText: "confirms nothing" }).waitFor();
  assert.equal(await other.locator("#confirm").count(), 0, "what a dead key confirms is asked for");
  const link = await page.locator("#confirm-link").inputValue();
  const asked = [];
  other.on("request", (request) => asked.push(request.url()));
  await other.goto("about:blank");
  await other.goto(link);
  await other.locator("#confirm").waitFor();
  assert.match(new URL(other.url()).hash, /^#\/alignment\/[0-9a-f-]{36}$/);
  assert(
    asked.length > 0 && asked.every((url) => !url.split("#")[0].includes("confirm_")),
    "a key was sent in a path",
  );
  await other.reload();
  await other.locator("#confirm").dblclick();
  await page.locator(".operator h3", { hasText: second }).waitFor({ state: "detached", timeout: 15_000 });
  assert.deepEqual(theirs(), []);
  await context.close();
}

/** How many prompts have been answered from a page since this was called. */
function confirmations(page) {
  let count = 0;
  page.on("request", (request) => {
    if (request.method() === "POST" && request.url().endsWith("/confirm")) count += 1;
  });
  return () => count;
}

/** Presses Tab until an element has the focus. */
async function reach(page, selector) {
  const there = () =>
    page.evaluate((selector) => document.activeElement?.matches(selector) ?? false, selector);
  for (let presses = 0; !(await there()); presses += 1) {
    assert(presses < 60, `${selector} is not reached by the keyboard`);
    await page.keyboard.press("Tab");
  }
}

/** At the prompt for the board, has the white frame taken again: the job asks for it, and then for the board. */
async function whiteFrameAgain(page) {
  await page.locator(".operator .set-up[data-setup=boards_in_air]").waitFor();
  assert.equal(await page.locator(".steps .again").count(), 1, "what can be done again is the white frame");
  await page.locator(".steps .again").dblclick();
  await page.locator(".steps .ask", { hasText: "Take the white frame again?" }).waitFor();
  await photograph(page, "again");
  await accessible(page);
  await page.getByRole("button", { name: "Do it again", exact: true }).dblclick();
  await page.locator(".operator .set-up[data-setup=diffuser]").waitFor({ timeout: 15_000 });
  await page.locator(".steps li[data-state=now]", { hasText: "step 1 once more" }).waitFor();
}

/** Answers what a job asks, in one way or another, until it is over; returns how often it asked. `timed` is whether the bench
 *  has done such a job before. */
async function answer(page, confirm, { meanwhile = async () => {}, timed = false } = {}) {
  let asked = 0;
  let place = null;
  const over = async () => {
    if (await page.locator(OVER).isVisible()) return true;
    assert(daemon.alive, "the daemon ended");
    const shown = await page.evaluate(meterInJob, OVER);
    assert.doesNotMatch(
      shown?.advice ?? "",
      /Move|must grow|must shrink/,
      "the meter gives orders during a job",
    );
    const told = timed ? "" : (shown?.progress ?? "");
    assert.doesNotMatch(told, /left/, "a bench that has done none knows how long one takes");
    const button = page.locator("#confirm");
    if (await button.isVisible()) {
      asked += 1;
      const now = await page.evaluate(places);
      place ??= now;
      assert.deepEqual(now, place, "the buttons of one prompt are not where those of the other were");
      await meterAtPrompt(page);
      await meanwhile(asked);
      const heading = await page.locator(".operator h3").textContent();
      await confirm(button);
      await page
        .locator(".operator h3", { hasText: heading })
        .waitFor({ state: "detached", timeout: 15_000 });
    }
    await meanwhile(0);
    return false;
  };
  await until(over, "the job did not end in time", ALIGNMENT_MS);
  return asked;
}

/** Cancels the job, which is asked about. */
async function cancel(page) {
  await page.locator("#cancel").click();
  await page.getByRole("button", { name: "Cancel it" }).click();
  await page.locator(".job .outcome.cancelled").waitFor({ timeout: 15_000 });
}

/** In the page: where the buttons of a prompt are in its card. */
function places() {
  const card = document.querySelector(".job").getBoundingClientRect();
  return ["#confirm", "#cancel"].map((selector) => {
    const { left, top } = document.querySelector(selector).getBoundingClientRect();
    return [Math.round(left - card.left), Math.round(top - card.top)];
  });
}

/** In the page: clicks whatever prompt appears in the moment in which it does. */
function hasty() {
  // One that is there already has had its time.
  const clicked = new WeakSet(document.querySelectorAll("#confirm"));
  new MutationObserver(() => {
    const confirm = document.querySelector("#confirm");
    if (!confirm || clicked.has(confirm)) return;
    clicked.add(confirm);
    confirm.click();
  }).observe(document.body, { childList: true, subtree: true });
}

/** Confirms what the job asks for by Enter until the job is over; returns how many iterations are shown, and prompts. */
async function seeThrough(page) {
  let photographed = false;
  await page.evaluate(hasty);
  const enter = async () => {
    // Whoever has been at something else goes back; at the next prompt the focus is there.
    if (!(await page.locator(".turn:focus-within").isVisible())) await reach(page, "#confirm");
    await page.locator("#confirm:focus").waitFor();
    await page.locator("#confirm:not([aria-disabled=true])").waitFor();
    await page.keyboard.press("Enter");
  };
  const look = async (prompt) => {
    if (prompt === 2) await photograph(page, "operator");
    if (prompt > 0 || photographed || (await page.locator(".iterations tbody tr").count()) < 3) return;
    photographed = true;
    await photograph(page, "running");
    await page.reload();
    await page.locator(".job .outcome").waitFor({ timeout: 10_000 });
    assert((await page.locator(".iterations tbody tr").count()) >= 3, "a reload loses iterations");
    await page.evaluate(hasty);
  };
  const asked = await answer(page, enter, { meanwhile: look, timed: true });
  assert(asked >= 3, `the operator was asked ${asked} times`);
  return { rows: await page.locator(".iterations tbody tr").count(), asked };
}

/** What the meter says while a job is under way, and how far that says it is; nothing where it is over. Runs in the page. */
function meterInJob(over) {
  const text = (selector) => document.querySelector(selector)?.textContent ?? "";
  return document.querySelector(over)
    ? null
    : { advice: text(".meter .advice"), progress: text(".job .progress") };
}

/** While the scene is set up, nothing is read of the one before; of the board that stays, no tilt is told. */
async function meterAtPrompt(page) {
  const instruction = await page.locator(".operator").innerText();
  await until(async () => (await page.title()).startsWith("● Your turn"), "the title does not call");
  if (/aperture/i.test(instruction)) {
    assert.doesNotMatch(
      await page.locator(".meter").innerText(),
      /Tilt (below )?\d/,
      "a tilt of a stepped board",
    );
    return;
  }
  await page.locator(".meter[data-state=being-set-up]", { hasText: "Being set up" }).waitFor();
  assert.equal(await page.locator(".meter .tag.good").count(), 0, "in focus, while it is set up");
}

/** Follows so many pictures, none of which is to be called stale. */
async function neverStale(page, count) {
  await page.evaluate(() => {
    globalThis.stale = 0;
    const look = (changes) => {
      globalThis.stale += changes.filter(({ target }) => target.dataset.state === "stale").length;
    };
    new MutationObserver(look).observe(document.querySelector(".picture"), {
      attributeFilter: ["data-state"],
    });
  });
  const frame = async () => /frame (\d+)/.exec(await page.locator(".picture p.facts").first().innerText())[1];
  for (let seen = 0, last = await frame(); seen < count; seen += 1) {
    last = await until(async () => ((await frame()) === last ? null : frame()), "no other picture comes");
  }
  assert.equal(await page.evaluate(() => globalThis.stale), 0, "stale at an age that it always has");
}

async function position(address, axis) {
  const bench = await (await fetch(new URL("/api/v1/bench", address))).json();
  return bench.axes.find((one) => one.axis === axis).position_mm;
}

/** Standard deviation of the canvas's grey levels. */
async function spread(page) {
  const grey = (await pixels(page, "canvas#live")).map(([red]) => red);
  const mean = grey.reduce((sum, level) => sum + level, 0) / grey.length;
  return Math.sqrt(grey.reduce((sum, level) => sum + (level - mean) ** 2, 0) / grey.length);
}

/** Share of the canvas that is coloured. */
async function coloured(page) {
  const all = await pixels(page, "canvas#live");
  return all.filter(([red, , blue]) => Math.abs(red - blue) > 30).length / all.length;
}

/** How many of the pixels looked at have something drawn over the picture. */
async function painted(page) {
  return (await pixels(page, "canvas.overlay")).filter(([, , , alpha]) => alpha > 0).length;
}

/** Some of a canvas's pixels, spread all over it. */
function pixels(page, selector) {
  return page.evaluate((selector) => {
    const canvas = document.querySelector(selector);
    // A worker draws on it: what it shows is read from a copy.
    const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
    copy.drawImage(canvas, 0, 0);
    const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
    const some = [];
    for (let at = 0; at + 3 < data.length; at += 4 * 37) some.push([...data.slice(at, at + 4)]);
    return some;
  }, selector);
}
