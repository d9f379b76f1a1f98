// How many pictures and readings a second the page shows of a daemon that runs already, on a screen of 1920 x 1080.
//
//   node e2e/pace.mjs ADDRESS SECONDS    prints {"pictures": …, "readings": …}

import { browse } from "./harness.mjs";

const [address, seconds] = process.argv.slice(2);
const browser = await browse();
try {
  const context = await browser.newContext({ viewport: { width: 1920, height: 1080 } });
  const page = await context.newPage();
  await page.goto(address);
  await page.locator(".picture[data-state=fresh]").waitFor({ timeout: 60_000 });
  const thread = page.workers().find((worker) => /viewer-worker/.test(worker.url()));
  await thread.evaluate(() => {
    globalThis.counts = { picture: 0, reading: 0 };
    const post = globalThis.postMessage;
    globalThis.postMessage = (report) => {
      if (report.is in globalThis.counts) globalThis.counts[report.is] += 1;
      post.call(globalThis, report);
    };
  });
  // What it takes to load the page is no part of it.
  await page.waitForTimeout(3000);
  const counts = () => thread.evaluate(() => ({ ...globalThis.counts, at: performance.now() }));
  const before = await counts();
  await page.waitForTimeout(Number(seconds) * 1000);
  const after = await counts();
  const rate = (what) => (after[what] - before[what]) / ((after.at - before.at) / 1000);
  console.log(JSON.stringify({ pictures: rate("picture"), readings: rate("reading") }));
} finally {
  await browser.close();
}
