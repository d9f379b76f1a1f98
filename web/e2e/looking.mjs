// Looking more closely, on a bench that is aligned: the meter by itself, what is measured in the picture, charts further back.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { accessible, darken, photograph, shots } from "./harness.mjs";
import { drawn, until } from "./until.mjs";

/** The meter by itself: the whole figure in the view, read from afar, with STOP and the tone, and without a picture. */
export async function meterAlone(page) {
  await page.locator(".meter .alone-link").click();
  const alone = page.locator(".meter-alone[data-old=false][data-direction=there]");
  await alone.waitFor({ timeout: 20_000 });
  await alone.locator(".glyph", { hasText: "✓" }).waitFor();
  await alone.locator(".age", { hasText: /^\d+\.\d s old$/ }).waitFor();
  const before = page.viewportSize();
  for (const [width, height] of [
    [360, 740],
    [740, 360],
  ]) {
    await page.setViewportSize({ width, height });
    await drawn(page);
    const figure = await alone.locator(".number").evaluate((element) => {
      const range = document.createRange();
      range.selectNodeContents(element);
      const { left, right, top, height } = range.getBoundingClientRect();
      return { left, right, top, height };
    });
    assert(figure.left >= 0 && figure.right <= width, `${figure.left} to ${figure.right} of ${width} px`);
    // 10 mm on a phone of 160 px an inch: what is read from 3 m.
    assert(figure.height >= 63, `the figure is ${figure.height} px high`);
  }
  await page.setViewportSize(before);
  await photograph(page, "meter-alone");
  await darken(page, "meter-alone");
  await accessible(page);
  await page.keyboard.press("t");
  await alone.locator("[aria-pressed=true]", { hasText: "Tone" }).waitFor();
  await page.keyboard.press("t");
  await alone.getByRole("button", { name: "Full screen" }).click();
  await until(() => page.evaluate(() => document.fullscreenElement !== null), "it has not the whole screen");
  assert(await page.locator("#stop").isVisible(), "no STOP in full screen");
  await alone.getByRole("button", { name: "Full screen" }).click();
  await until(() => page.evaluate(() => document.fullscreenElement === null), "the whole screen is kept");
  await page.getByRole("link", { name: "Whole page" }).click();
  await page.locator("main[data-page=live]").waitFor();
}

/** An open explanation takes no press on STOP, wherever its word is on the screen. */
async function stopsWhereverTheWordIs(page, word) {
  for (const block of ["start", "center", "end"]) {
    await word.evaluate((element, block) => element.scrollIntoView({ block }), block);
    await drawn(page);
    const covered = await page.evaluate(() => {
      const stop = document.querySelector("#stop");
      const { left, top, width, height } = stop.getBoundingClientRect();
      const at = (x, y) => document.elementFromPoint(left + x * width, top + y * height);
      const shares = [0.1, 0.5, 0.9];
      return shares.flatMap((x) => shares.map((y) => at(x, y))).filter((element) => !stop.contains(element))
        .length;
    });
    assert.equal(covered, 0, `the explanation covers STOP where its word is at the ${block}`);
  }
}

/** Two boards where one should be: the meter says so with the spacing of each, calls nothing in focus and orders no move, on
 *  the page and by itself, until there is one again. */
export async function twoBoards(page) {
  const open = async (name) => {
    await page.locator("nav a", { hasText: name }).click();
    await page.locator(`main[data-page=${name.toLowerCase()}]`).waitFor();
  };
  await page.locator(".meter[data-old=false][data-direction=there]").waitFor({ timeout: 20_000 });
  await open("Settings");
  const nearer = page.getByLabel("A second board nearer by");
  await nearer.fill("250");
  await nearer.press("Tab");
  await page.locator("#faults-state", { hasText: "wrong on purpose" }).waitFor();
  await watchFigures(page, Date.now() + ON_ITS_WAY_MS);
  await open("Live");
  const meter = page.locator(".meter[data-old=false][data-direction=two_boards]");
  await meter.locator(".advice", { hasText: "Two boards in view." }).waitFor({ timeout: 20_000 });
  await saysTwo(meter);
  // Nor was there a figure before a frame was measured in whole.
  assert.deepEqual(await page.evaluate(() => globalThis.figures), []);
  await accessible(page);
  await photograph(page, "two-boards");
  await meter.locator(".alone-link").click();
  await saysTwo(page.locator(".meter-alone[data-direction=two_boards]"));
  await page.getByRole("link", { name: "Whole page" }).click();
  await open("Settings");
  await page.locator("#faults-none").click();
  await page.locator("#faults-state", { hasText: "Nothing is wrong" }).waitFor();
  await open("Live");
  await page.locator(".meter[data-old=false][data-direction=there]").waitFor({ timeout: 20_000 });
}

/** A frame that is being taken while a board comes into view may show it or not, ms. */
const ON_ITS_WAY_MS = 300;

/** Keeps every figure that the meter shows of a frame that is taken after a moment, ms. */
async function watchFigures(page, from) {
  await page.evaluate((from) => {
    globalThis.figures = [];
    const look = () => {
      const figure = document.querySelector("#spacing");
      if (figure && Number(figure.dataset.capturedAt) > from)
        globalThis.figures.push(figure.parentElement.innerText);
    };
    const watched = { subtree: true, childList: true, attributes: true, characterData: true };
    new MutationObserver(look).observe(document.body, watched);
  }, from);
}

async function saysTwo(meter) {
  const said = await meter.innerText();
  assert.match(said, /≠/);
  assert.doesNotMatch(said, /✓|in focus|on target|Move |must (grow|shrink)|Tilt (below )?\d/i);
  const [, most, some] =
    /The spacing is ([\d.]+) px over most of the picture and ([\d.]+) px over \d+ %/.exec(said);
  assert.notEqual(most, some);
}

/** Charts go back to when the page was opened, and to the last two minutes by one press. */
export async function chartsBack(page) {
  const charts = page.locator(".charts");
  const row = charts.locator(".chart-row");
  const heading = charts.locator("h2");
  const looked = (as) => charts.locator(`.chart-row[data-looked=${as}]`).waitFor();
  await looked("recent");
  await charts.getByRole("button", { name: "A shorter stretch" }).click();
  await looked("stretch");
  const first = await heading.innerText();
  assert.match(first, /^\d\d:\d\d:\d\d to \d\d:\d\d:\d\d$/);
  const length = (text) => {
    const [from, to] = [...text.matchAll(/(\d\d):(\d\d):(\d\d)/g)].map(
      ([, hours, minutes, seconds]) => 3600 * hours + 60 * minutes + 1 * seconds,
    );
    return (to - from + 86_400) % 86_400;
  };
  assert(Math.abs(length(first) - 80) <= 1, first);

  // The wheel over a chart, not the page, and about where it is.
  const over = charts.locator(".chart .u-over").first();
  await over.scrollIntoViewIfNeeded();
  const box = await over.boundingBox();
  let at = box.x + box.width / 2;
  await page.mouse.move(at, box.y + box.height / 2);
  await drawn(page);
  const before = await page.evaluate(() => scrollY);
  await until(async () => {
    await page.mouse.move((at += 1), box.y + box.height / 2);
    await page.mouse.wheel(0, -250);
    return length(await heading.innerText()) < 60;
  }, "the wheel does not zoom");
  assert.equal(await page.evaluate(() => scrollY), before, "the page is scrolled as well");

  const held = await heading.innerText();
  await page.mouse.move(box.x + box.width / 4, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + (3 * box.width) / 4, box.y + box.height / 2, { steps: 4 });
  await page.mouse.up();
  await until(async () => (await heading.innerText()) < held, "dragging to the right does not go back");
  assert(Math.abs(length(await heading.innerText()) - length(held)) <= 1, "dragging zooms");
  await drawn(page);
  await photograph(page, "charts-held");

  await row.focus();
  await page.keyboard.press("-");
  await until(async () => length(await heading.innerText()) > length(held), "the keyboard does not zoom");
  await page.keyboard.press("0");
  await looked("recent");
  await charts.getByRole("button", { name: "All", exact: true }).click();
  await looked("whole");
  await until(
    async () => (await charts.locator(".chart-none").count()) === 0,
    "nothing is charted of all that was seen",
  );
  await accessible(page);
  await charts.getByRole("button", { name: "Two minutes" }).click();
  await looked("recent");
}

/** What is measured in the raw frame, by pointer and by keys, says what the meter says, and is kept with the picture. */
export async function measured(page) {
  const picture = page.locator(".picture");
  const region = page.locator("#region");
  const numbers = (text, pattern) => pattern.exec(text)?.slice(1).map(Number);
  const place = async () =>
    numbers(await region.innerText(), /Region of (\d+) × (\d+) px at (\d+), (\d+)/) ??
    assert.fail("no region");

  await picture.getByRole("button", { name: "Crosshair" }).click();
  await picture.getByRole("button", { name: "Region" }).click();
  await region.locator("span > span", { hasText: /^grey \d+\.\d on average, \d+ to \d+ of 255$/ }).waitFor();
  await region.locator("[data-old=false] > span", { hasText: /^spacing/ }).waitFor();
  const [spacing, sigma] = numbers(await region.innerText(), /spacing ([\d.]+) ± ([\d.]+) px/);
  const meter = Number(await page.locator("#spacing").innerText());
  assert(Math.abs(spacing - meter) < 5 * sigma + 0.02, `the region says ${spacing}, the meter ${meter}`);

  // Drawn by a drag, whichever way, and moved and resized by keys.
  const canvas = page.locator("#live");
  await canvas.scrollIntoViewIfNeeded();
  const box = await canvas.boundingBox();
  const at = (x, y) => [box.x + x * box.width, box.y + y * box.height];
  await page.mouse.move(...at(0.8, 0.7));
  await page.mouse.down();
  await page.mouse.move(...at(0.3, 0.2), { steps: 3 });
  await page.mouse.up();
  await until(async () => (await place())[2] < 200, "a drag draws no region");
  const drag = await place();
  const frame = await page.evaluate(async () => {
    const { width, height } = await createImageBitmap(await (await fetch("/api/v1/frame.png")).blob());
    return { width, height };
  });
  assert(Math.abs(drag[0] - 0.5 * frame.width) <= 3 && Math.abs(drag[2] - 0.3 * frame.width) <= 3, `${drag}`);
  await canvas.focus();
  await page.keyboard.press("ArrowRight");
  await until(async () => (await place())[2] > drag[2], "an arrow does not move it");
  await page.keyboard.press("Shift+ArrowDown");
  await until(async () => (await place())[1] > drag[1], "Shift and an arrow do not resize it");
  await photograph(page, "measuring");
  await darken(page, "measuring");

  const kept = async (name) => {
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      picture.getByRole("button", { name }).click(),
    ]);
    const path = `${shots}/${name.toLowerCase().replaceAll(" ", "-")}.png`;
    await download.saveAs(path);
    return { name: download.suggestedFilename(), path, bytes: readFileSync(path) };
  };
  const snapshot = await kept("Snapshot");
  assert.match(snapshot.name, /^plenalign-\d{8}T\d{6}\.\d{3}Z-frame-\d+-simulated(-preview)?-view\.png$/);
  const seen = await page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
    const live = document.querySelector("#live");
    let marked = 0;
    for (let i = 0; i < data.length; i += 4) if (data[i] - data[i + 2] > 100) marked += 1;
    return { width: bitmap.width, height: bitmap.height, marked, view: [live.width, live.height] };
  }, snapshot.bytes.toString("base64"));
  assert(seen.width <= seen.view[0] && seen.height <= seen.view[1] && seen.width > 200, JSON.stringify(seen));
  assert(seen.marked > 500, "neither marks nor stamp are in the snapshot");

  const raw = await kept("Raw file");
  assert.match(raw.name, /^plenalign-\d{8}T\d{6}\.\d{3}Z-frame-\d+-simulated(-preview)?-raw\.png$/);
  const header = { width: raw.bytes.readUInt32BE(16), height: raw.bytes.readUInt32BE(20) };
  assert.deepEqual(header, frame);

  await picture.getByRole("button", { name: "Distance" }).click();
  await region.waitFor({ state: "detached" });
  await page.mouse.move(...at(0.25, 0.5));
  await page.mouse.down();
  await page.mouse.move(...at(0.75, 0.5), { steps: 3 });
  await page.mouse.up();
  const distance = page.locator("#distance", { hasText: /Distance [\d.]+ px\s*[\d.]+ micro-images/ });
  await distance.waitFor();
  const [px, lenses] = await until(async () => {
    const found = numbers(await distance.innerText(), /Distance ([\d.]+) px\s+([\d.]+) micro-images/);
    return Math.abs(found[0] - 0.5 * frame.width) <= 3 && found;
  }, "a drag draws no distance");
  assert(px / lenses > 25 && px / lenses < 35, `micro-images of ${px / lenses} px`);
  await canvas.focus();
  await page.keyboard.press("Escape");
  await distance.waitFor({ state: "detached" });
  await picture.getByRole("button", { name: "Crosshair" }).click();

  await picture.getByRole("button", { name: "Large" }).click();
  await page.locator(".picture[data-large=true][data-state=fresh]").waitFor();
  assert.equal(await page.locator(".meter").count(), 0);
  assert(await page.locator("#stop").isVisible(), "no STOP beside the large picture");
  await drawn(page);
  await page.screenshot({ path: `${shots}/large.png` });
  await picture.getByRole("button", { name: "Large" }).click();
  await page.locator(".meter").waitFor();
  await page.locator(".picture[data-large=false][data-state=fresh]").waitFor();
}

/** Words of the field are explained where they stand, in the glossary's words, to pointer, keyboard and finger. */
export async function explained(page) {
  const glossary = readFileSync("../docs/glossary.md", "utf8").replaceAll("`", "");
  const tip = page.locator("[role=tooltip]");
  const known = async (symbol) => {
    const row = glossary.split("\n").find((line) => line.split("|")[2]?.trim() === symbol);
    const meaning = row.split("|")[4].trim();
    await tip.filter({ hasText: meaning }).waitFor();
  };
  const word = (within, name) => page.locator(within).getByRole("button", { name, exact: true }).first();

  const eog = word(".charts", "EOG");
  await eog.evaluate((element) => element.scrollIntoView({ block: "center" }));
  await drawn(page);
  await eog.hover();
  await known("EOG");
  await accessible(page);
  await page.mouse.move(0, 0);
  await tip.waitFor({ state: "detached" });

  await word(".axes", "e").focus();
  await page.keyboard.press("Shift+Tab");
  await page.keyboard.press("Tab");
  await known("e");
  await page.keyboard.press("Escape");
  await tip.waitFor({ state: "detached" });
  await page.keyboard.press("Enter");
  await known("e");
  await page.keyboard.press("Enter");
  await tip.waitFor({ state: "detached" });

  await page.locator("nav a", { hasText: "Alignment" }).click();
  await page.locator("#kind").selectOption("l_bound_measurement");
  await page.locator(".start").getByRole("button", { name: "l_bound", exact: true }).click();
  await known("l_bound");
  await page.setViewportSize({ width: 360, height: 740 });
  await drawn(page);
  const box = await tip.boundingBox();
  assert(box.x >= 0 && box.x + box.width <= 360, JSON.stringify(box));
  await page.screenshot({ path: `${shots}/explained-360.png` });
  await stopsWhereverTheWordIs(page, page.locator(".start [aria-expanded=true]"));
  await page.setViewportSize({ width: 1024, height: 900 });
  await page.locator("h1").click();
  await tip.waitFor({ state: "detached" });
  await page.locator(".start").getByRole("button", { name: "e", exact: true }).click();
  await known("e");
  await page.screenshot({ path: `${shots}/explained.png` });
  await page.keyboard.press("Escape");
  await page.locator("#kind").selectOption("joint_alignment");
  await page.locator("nav a", { hasText: "Design" }).click();
  await word("main", "Δv").click();
  await known("Δv");
  await page.keyboard.press("Escape");
  await page.locator("nav a", { hasText: "Live" }).click();
  await page.locator("main[data-page=live]").waitFor();
}
