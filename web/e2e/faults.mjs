// Faults of the simulated bench, made and made good from the page, and what the page then shows.

import assert from "node:assert/strict";
import { accessible, browse, faults, folder, open, photograph, start, step } from "./harness.mjs";

const bench = folder(`
[sensor]
width_px = 320
height_px = 320

[bench.simulation]
rays = 1
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
  await page.locator("#stage-gone").waitFor({ timeout: 20_000 });
  const slip = panel.getByRole("group", { name: "e axis" }).getByLabel("Slips by");
  await slip.fill("12.5");
  await slip.blur();
  await page.waitForFunction(async () => {
    const now = await (await fetch("/api/v1/simulation/faults")).json();
    return now.e.slip_share === 0.125 && now.serial.unplugged && now.camera.unplugged;
  });

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
  assert.deepEqual(own(), []);
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  bench.remove();
}
