// Looking more closely, on a bench that is aligned: the meter by itself, what is measured in the picture, charts further back.

import assert from "node:assert/strict";
import { accessible, darken, photograph } from "./harness.mjs";
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
