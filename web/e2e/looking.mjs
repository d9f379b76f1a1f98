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
