// The design page: values are edited and results follow, the drawing is to scale, a draft is saved into the
// configuration where that is allowed, and what keeps it from that is said.

import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import { labelled, lengthsIn, printed } from "./checks.mjs";
import {
  accessible,
  browse,
  darken,
  faults,
  folder,
  open,
  photograph,
  shots,
  start,
  step,
} from "./harness.mjs";
import { drawn, until } from "./until.mjs";

const SMALL = `
[sensor]
width_px = 320
height_px = 320

[bench.simulation]
rays = 1
preview_rays = 1
preview_rate_hz = 2.0
`;
const place = folder(`# The bench in the cellar.\n${SMALL}`);
let daemon = start(place);
const browser = await browse();

try {
  const address = await daemon.address();
  const page = await browser.newPage({ viewport: { width: 1280, height: 1000 } });
  const own = faults(page);
  await page.goto(address);
  await open(page, "Design");

  step("the configured camera is worked out");
  const figure = (row, state) =>
    page
      .locator(".figures tr", { has: page.locator("th", { hasText: row }) })
      .locator(`td[data-state=${state}]`);
  const deltaV = figure("Δv", "joint").first();
  await page.locator(".figures").waitFor();
  assert.match(await deltaV.innerText(), /^\+2\.205 mm$/);
  assert.match(await figure("Δv", "clarity").first().innerText(), /^\+1\.745 mm$/);
  assert.match(await figure("Aperture", "joint").innerText(), /^6\.364 mm$/);
  assert(await page.locator("#save").isDisabled());
  await page.locator("#save-more", { hasText: "Nothing differs" }).waitFor();
  const lines = await page.locator(".draft-field .unit").evaluateAll((units) =>
    units.map((unit) => {
      const words = document.createRange();
      words.selectNodeContents(unit);
      return words.getClientRects().length;
    }),
  );
  assert(lines.includes(1) && Math.max(...lines) === 1, `units on several lines: ${lines}`);

  step("what is typed is worked out at once, and the newest answer stands");
  const distance = page.getByLabel("Distance in water, from the shell");
  const asked = [];
  const isFirst = (request) => request.postDataJSON()?.object?.distance_mm === 400;
  let letGo;
  const held = new Promise((resolve) => (letGo = resolve));
  await page.route("**/api/v1/design", async (route) => {
    asked.push(route.request().postDataJSON());
    // The first answer comes after the second.
    if (isFirst(route.request())) await held;
    await route.continue();
  });
  const late = page.waitForResponse((response) => isFirst(response.request()));
  await distance.fill("400");
  await until(() => asked.some((body) => body.object?.distance_mm === 400), "the first is not asked for");
  await distance.fill("600");
  await page.waitForFunction(
    () => document.querySelector(".figures td[data-state=joint]")?.textContent !== "+2.205 mm",
  );
  const there = await deltaV.innerText();
  letGo();
  await (await late).finished();
  await drawn(page);
  assert.equal(await deltaV.innerText(), there, "an answer of old took the place of the newest");
  assert.deepEqual(asked.at(-1), { base: "in_force", object: { distance_mm: 600 } });
  await page.unroute("**/api/v1/design");

  step("lengths are edited in the unit chosen");
  await page.locator(".draft").getByRole("button", { name: "µm", exact: true }).click();
  await holds(distance, "600000");
  assert.match(await deltaV.innerText(), /µm$/);
  await lengthsIn(page, "µm", ".outcome-column");
  await distance.fill("800000");
  await page.waitForFunction(
    () => document.querySelector(".figures td[data-state=joint]")?.textContent === "+2205 µm",
  );
  await page.locator(".draft").getByRole("button", { name: "mm", exact: true }).click();
  await holds(distance, "800");

  step("the drawing is to scale");
  const scale = await page.locator("svg.train").evaluate((svg) => {
    const shell = svg.querySelector(".edge").getBoundingClientRect();
    const sensor = svg.querySelector(".sensor").getBoundingClientRect();
    const { width, height } = svg.viewBox.baseVal;
    const drawn = svg.getBoundingClientRect();
    return {
      shell: shell.height / (sensor.y + sensor.height / 2 - shell.y) / 2,
      aspect: Math.min(drawn.width / width, drawn.height / height),
      radius: shell.height / 2,
    };
  });
  assert(Math.abs(scale.radius / scale.aspect / 59 - 1) < 0.03, JSON.stringify(scale));
  assert.equal(await page.locator("svg.train .ray").count(), 9);
  for (const part of ["Whole scene", "MLA and sensor", "Camera and shell"]) {
    await page.getByRole("button", { name: part }).click();
    await page.locator(`svg.train[aria-label^="${part}"]`).waitFor();
  }

  step("curves can be read off");
  for (const [index, said] of [
    /^e, mm [\d.−]+ · Δv in focus, mm [12]\.\d+$/,
    /field of view/,
    /Joint 0/,
  ].entries()) {
    await page.locator(".curves .u-over").nth(index).hover();
    await page.locator(".curves .read-off").nth(index).filter({ hasText: said }).waitFor();
  }

  step("no word of the drawing is over another, whatever is drawn and however wide it is");
  for (const width of [360, 900, 1280, 1920]) {
    await page.setViewportSize({ width, height: 1000 });
    for (const state of ["Air design", "Shell added", "Clarity", "Joint"]) {
      await page.getByRole("button", { name: state, exact: true }).click();
      for (const part of ["Whole scene", "MLA and sensor", "Camera and shell"]) {
        await page.getByRole("button", { name: part }).click();
        const drawing = page.locator(`svg.train[aria-label^="${part} of ${state}"]`);
        await drawing.waitFor();
        await drawn(page);
        await labelled(drawing, part === "Whole scene" ? 2 : 3);
      }
    }
  }
  await page.setViewportSize({ width: 1280, height: 1000 });

  step("another camera is set beside it");
  await page.getByLabel("Outer radius").fill("70");
  await page.getByRole("button", { name: "the paper’s preset" }).click();
  await page.locator(".figures .other[data-differs=true]").first().waitFor();
  assert.equal(await page.locator("svg.train").count(), 2);
  assert.match(await figure("Δv", "joint").first().locator(".other").innerText(), /^\+2\.205 mm$/);
  for (const drawing of await page.locator("svg.train").all()) await labelled(drawing, 4);
  await photograph(page, "design");
  await printed(page, "design");
  await darken(page, "design");
  await accessible(page);

  step("on a phone the results are in sight in short from every field, and a press away in full");
  await page.setViewportSize({ width: 360, height: 740 });
  const summary = page.locator(".summary");
  for (const name of ["Focal length", "Inner radius", "Blur still sharp"]) {
    await page.getByLabel(name, { exact: true }).first().scrollIntoViewIfNeeded();
    const [seen, stop] = [await summary.boundingBox(), await page.locator("#stop").boundingBox()];
    assert(seen && seen.y > 0 && seen.y + seen.height <= stop.y, `${name}: ${JSON.stringify([seen, stop])}`);
  }
  assert.match(await summary.innerText(), /Δv\s+\+\d\.\d{3} mm/);
  await page.screenshot({ path: `${shots}/design-fields-360.png` });
  await summary.locator("button").click();
  await page.waitForFunction(() => {
    const { top } = document.querySelector(".figures").getBoundingClientRect();
    const { bottom } = document.querySelector("header").getBoundingClientRect();
    return top >= bottom && top < innerHeight / 2;
  });
  await page.setViewportSize({ width: 1280, height: 1000 });
  assert(!(await summary.isVisible()));

  step("an impossible camera is named at its field, and what was is dimmed");
  await page.getByLabel("Inner radius").fill("90");
  await page.locator(".draft-field .fault", { hasText: "no thickness" }).waitFor();
  await page.locator(".outcome-column[data-stale=true]").waitFor();
  assert(await page.locator("#save").isDisabled());
  await page.getByLabel("Inner radius").fill("wide");
  await page.locator(".draft-field .fault", { hasText: "It is no number" }).waitFor();
  await page.getByLabel("Inner radius").fill("51");
  await page.locator(".outcome-column[data-stale=false]").waitFor();

  step("a look at another page loses nothing of the draft, not even what is no number");
  await page.getByLabel("Pitch").fill("small");
  await open(page, "History");
  await page.goBack();
  await holds(page.getByLabel("Inner radius"), "51");
  await holds(page.getByLabel("Pitch"), "small");
  await page.locator(".draft-field .fault", { hasText: "It is no number" }).waitFor();
  await page.getByLabel("Pitch").fill("0.1");
  await page.locator(".outcome-column[data-stale=false]").waitFor();

  step("what the bench cannot reach is worked out, and not saved");
  await page.getByLabel("e at first").fill("45");
  await page.locator(".save .fault", { hasText: "assembly.initial_e_mm" }).waitFor();
  assert(await page.locator("#save").isDisabled());
  await page.getByLabel("e at first").fill("28");

  step("the water is said by its conditions");
  await page.getByRole("button", { name: "by its conditions" }).click();
  await page.getByLabel("Salinity").fill("35");
  await page.locator(".draft-fields", { hasText: "Refractive index 1.34" }).waitFor();

  step("the draft is saved, and nothing else of the file");
  await page.locator("#save:not([aria-disabled=true])").click();
  await page.locator(".save .notice", { hasText: "Start the daemon again" }).waitFor();
  const file = readFileSync(place.file, "utf8");
  assert.match(file, /^# The bench in the cellar\./);
  assert.match(file, /outer_radius_mm = 70/);
  assert.match(file, /salinity_permille = 35/);
  assert.doesNotMatch(file, /pitch_mm/);

  step("what waits for the daemon's next start is what is edited, and can be set back to what is in force");
  await page.locator("#save-more", { hasText: "Nothing differs" }).waitFor();
  assert(await page.locator("#back").isDisabled());
  await page.reload();
  await holds(page.getByLabel("Outer radius"), "70");
  await holds(page.getByLabel("Salinity"), "35");
  assert.equal(await page.locator(".draft-field[data-changed=true]").count(), 0);
  const waiting = page.locator(".save .notice", { hasText: "Waiting for the daemon's next start" });
  await waiting.filter({ hasText: "shell.outer_radius_mm" }).waitFor();
  await page.getByLabel("Inner radius").fill("53");
  await page.locator("#save:not([aria-disabled=true])").click();
  await page.locator("#save-more", { hasText: "Nothing differs" }).waitFor();
  assert.match(readFileSync(place.file, "utf8"), /inner_radius_mm = 53/);
  await page.getByLabel("Inner radius").fill("51");
  await page.locator("#save:not([aria-disabled=true])").click();
  await page.locator("#save-more", { hasText: "Nothing differs" }).waitFor();
  assert.match(readFileSync(place.file, "utf8"), /inner_radius_mm = 51/);
  await page.getByLabel("Outer radius").fill("69");
  await page.locator("#back").click();
  await holds(page.getByLabel("Outer radius"), "70");
  await page.getByRole("button", { name: "the camera in force" }).click();
  const inForce = figure("Δv", "joint").first().locator(".other");
  await until(async () => (await inForce.innerText()) === "+2.205 mm", "the camera in force is another");
  await page.getByRole("button", { name: "nothing", exact: true }).click();

  step("what is wrong in the configuration is shown, whatever is looked for");
  await open(page, "Settings");
  await page.locator(".find input").fill("outer_radius");
  await page.locator("#key-shell\\.outer_radius_mm").fill("10");
  const wrong = page.locator('.config-key[data-wrong="true"]');
  await wrong.first().waitFor();
  await page.locator(".apply", { hasText: "1 thing is wrong" }).waitFor();
  assert.equal(await wrong.locator(".fault").count(), 1);

  step("what is written into the file elsewhere is shown, with what is being edited here");
  await page.locator(".find input").fill("radius");
  await page.locator("#key-shell\\.outer_radius_mm").fill("1,234.5");
  await page.locator(".config-key .fault", { hasText: "It is no number" }).waitFor();
  await page.locator("#key-shell\\.outer_radius_mm").fill("10");
  const change = (from, to) => writeFileSync(place.file, readFileSync(place.file, "utf8").replace(from, to));
  change("inner_radius_mm = 51", "inner_radius_mm = 50");
  await holds(page.locator("#key-shell\\.inner_radius_mm"), "50");
  await holds(page.locator("#key-shell\\.outer_radius_mm"), "10");
  await page.locator("#key-shell\\.outer_radius_mm").fill("71");
  change("outer_radius_mm = 70", "outer_radius_mm = 72");
  await page.locator(".apply .notice.wrong", { hasText: "shell.outer_radius_mm = 72" }).waitFor();
  await holds(page.locator("#key-shell\\.outer_radius_mm"), "71");
  change("outer_radius_mm = 72", "outer_radius_mm = ");
  await page.locator(".configuration > .notice.wrong", { hasText: "cannot be used" }).waitFor();
  await holds(page.locator("#key-shell\\.outer_radius_mm"), "71");
  await photograph(page, "settings-broken-file");
  change("outer_radius_mm = ", "outer_radius_mm = 70");
  await page.locator(".configuration > .notice.wrong").waitFor({ state: "detached" });
  await holds(page.locator("#key-shell\\.outer_radius_mm"), "71");

  step("while a job runs nothing is written, and that it is recorded is said");
  const send = (method, path, body, headers = {}) =>
    fetch(new URL(`api/v1/${path}`, address), {
      method,
      headers: { "content-type": "application/json", ...headers },
      body: body && JSON.stringify(body),
    });
  const { key } = await (await send("POST", "lease", { owner: "Ada", ttl_s: 60 })).json();
  const leased = { "plenalign-lease": key };
  const watch = { kind: "spacing_watch", duration_s: 600, record: true };
  const begun = await send("POST", "jobs", watch, leased);
  assert.equal(begun.status, 201, await begun.clone().text());
  await page.locator(".apply", { hasText: "A job holds the bench" }).waitFor();
  assert(await page.locator("#apply").isDisabled(), "a file that cannot be written now is offered to be");
  const other = await browser.newPage();
  await other.goto(`${address}#/alignment`);
  await other.locator(".job", { hasText: "being recorded" }).waitFor();
  await send("POST", "stop");
  await send("DELETE", "stop", undefined, leased);
  await page.locator(".apply", { hasText: "A job holds the bench" }).waitFor({ state: "detached" });
  await until(() => page.locator("#apply").isEnabled(), "what could be written stays barred");
  await other.locator(".job .downloads a", { hasText: "Recording" }).waitFor();

  step("what waits for the daemon's next start is said where a job is started");
  await other.locator(".job-page .waiting", { hasText: "shell.inner_radius_mm" }).waitFor();
  await page.getByRole("button", { name: "Undo changes" }).click();
  await open(page, "Design");
  await holds(page.getByLabel("Inner radius"), "50");
  change("inner_radius_mm = 50", "inner_radius_mm = 51");
  await holds(page.getByLabel("Inner radius"), "51");
  await until(
    async () => !(await other.locator(".job-page .waiting").innerText()).includes("shell.inner_radius_mm"),
    "what waits no more is said to",
  );

  step(
    "started again with another camera, the daemon's is in force on every page that is open, but for what is being edited",
  );
  await other.locator("#plan summary").waitFor();
  const before = await other.locator("#plan").textContent();
  await page.getByLabel("Blur still sharp").fill("0.04");
  await page.locator(".draft-field[data-changed=true]").waitFor();
  const drafted = "+2.338 mm";
  await until(
    async () => (await deltaV.innerText()) === drafted,
    "it is not of the shell that waits for the daemon's next start",
  );
  daemon.process.kill("SIGKILL");
  await daemon.ended;
  await page.locator(".link[data-link=lost]").waitFor();
  // What it had is there, marked, also for who comes back to it.
  await open(page, "History");
  await open(page, "Design");
  await page.locator(".draft .tag.old", { hasText: /^OLD · / }).waitFor();
  await page.locator(".outcome-column[data-stale=true] .tag.old").waitFor();
  assert.equal(await deltaV.innerText(), drafted);
  await holds(page.getByLabel("Blur still sharp"), "0.04");
  await photograph(page, "design-lost");
  daemon = start(place, new URL(address).host);
  await holds(page.getByLabel("Outer radius"), "70");
  await holds(page.getByLabel("Blur still sharp"), "0.04");
  assert.deepEqual(
    await page.locator(".draft-field[data-changed=true] label").allInnerTexts(),
    ["Blur still sharp"],
    "what was in force before is taken for a change",
  );
  await until(async () => {
    const [plan] = await other.locator("#plan").allTextContents();
    return plan && plan !== before;
  }, "the plan is of the camera before");

  assert.deepEqual(own(), []);
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  place.remove();
}

/** Waits until a field holds a text. */
async function holds(field, text) {
  await until(async () => (await field.inputValue()) === text, `the field does not hold ${text}`);
}
