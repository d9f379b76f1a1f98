// Signing in: the one-time link, out again, a token. The real program, the real page, a real browser.
//
//   PLENALIGN, CHROMIUM   as for align.mjs

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const built = ["../target/debug/plenalign", "../target/release/plenalign"];
const program = process.env.PLENALIGN ?? built.find((path) => existsSync(path));
assert(program, "build the program first: cargo build");
const state = mkdtempSync(join(tmpdir(), "plenalign-e2e-"));
const config = join(state, "bench.toml");
writeFileSync(config, `[bench.simulation]\nrays = 4\n[server]\nauth = "required"\n`);
const env = { ...process.env, PLENALIGN_STATE_DIR: state };

const daemon = spawn(program, ["serve", "--simulated", "--listen", "127.0.0.1:0", "--config", config], {
  stdio: ["ignore", "pipe", "ignore"],
  env,
});
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--disable-background-networking"],
});

try {
  const address = await firstAddress();
  const link = await oneTimeLink();
  const page = await browser.newPage({ viewport: { width: 1024, height: 900 } });

  console.log("- a stranger is asked for a token and shown nothing");
  await page.goto(address);
  await page.locator("#sign-in").waitFor();
  assert.equal(await page.locator("#stop").count(), 0);

  console.log("- nor the API's contract");
  await page.goto(`${address}api/v1/docs`);
  await page.locator("#sign-in", { hasText: "sign in" }).waitFor();
  assert.equal(await page.locator(".opblock").count(), 0);

  console.log("- the one-time link opens the page and leaves nothing in the address bar");
  await page.goto(link);
  await page.locator(".who", { hasText: "one-time link" }).waitFor({ timeout: 10_000 });
  await page.locator(".axes").waitFor();
  assert.equal(page.url(), address);
  await page.reload();
  await page.locator(".who", { hasText: "one-time link" }).waitFor({ timeout: 10_000 });

  console.log("- the API's contract is shown, with nothing from elsewhere, and can be tried");
  const complaints = [];
  const heard = (message) => message.type() === "error" && complaints.push(message.text());
  page.on("console", heard);
  const asked = (request) => {
    if (!request.url().startsWith(address) && !request.url().startsWith("data:"))
      complaints.push(request.url());
  };
  page.on("request", asked);
  await page.goto(`${address}api/v1/docs`, { timeout: 120_000 });
  await page.locator("#operations-stop-get_stop .opblock-summary").click({ timeout: 120_000 });
  await page.locator("#operations-stop-get_stop .try-out__btn").click();
  await page.locator("#operations-stop-get_stop .execute").click();
  await page
    .locator("#operations-stop-get_stop .live-responses-table", { hasText: '"latched": false' })
    .waitFor();
  if (process.env.SCREENSHOT) await page.screenshot({ path: process.env.SCREENSHOT });
  assert.deepEqual(complaints, []);
  page.off("console", heard);
  page.off("request", asked);
  await page.goto(address);
  await page.locator(".who", { hasText: "one-time link" }).waitFor({ timeout: 60_000 });

  console.log("- signed out, nothing is left on the screen, and the link is dead");
  await page.locator("#sign-out").click();
  await page.locator("#sign-in").waitFor();
  assert.equal(await page.locator(".axes").count(), 0);
  await page.goto(link);
  await page.locator("header .problem").waitFor();
  await page.locator("#sign-in").waitFor();

  console.log("- a wrong token is told, a right one lets in");
  await page.locator("#sign-in input").fill("plenalign_wrong");
  await page.locator("#sign-in button").click();
  await page.locator("#sign-in .problem").waitFor();
  const made = ["token", "create", "--name", "Vera", "--scope", "view"];
  const token = execFileSync(program, made, { env, stdio: ["ignore", "pipe", "ignore"] }).toString();
  await page.locator("#sign-in input").fill(token.trim());
  await page.locator("#sign-in button").click();
  await page.locator(".who", { hasText: "Vera" }).waitFor({ timeout: 10_000 });

  console.log("- who may look may stop");
  await page.locator("#stop").click();
  await page.locator("#reset").waitFor();

  console.log("- a token that is revoked ends what is shown");
  execFileSync(program, ["token", "revoke", "Vera"], { env });
  await page.reload();
  await page.locator("#sign-in").waitFor({ timeout: 10_000 });
} finally {
  await browser.close();
  daemon.kill("SIGKILL");
  rmSync(state, { recursive: true, force: true });
}

/** The address the daemon prints. */
async function firstAddress() {
  for await (const line of createInterface({ input: daemon.stdout })) {
    const found = /http:\/\/\S+/.exec(line);
    if (found) return found[0];
  }
  throw new Error("the daemon ended without saying its address");
}

/** The link that the daemon puts into its state folder. */
async function oneTimeLink() {
  const file = join(state, "login-url");
  for (let tries = 0; tries < 200; tries++) {
    if (existsSync(file)) return readFileSync(file, "utf8").trim();
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  throw new Error("the daemon made no one-time link");
}
