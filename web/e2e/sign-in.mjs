// Signing in: the one-time link, out again, a token; what who may only look is offered.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { existsSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { accessible, browse, folder, open, program, shots, start, step } from "./harness.mjs";
import { drawn, until } from "./until.mjs";

const place = folder(`[bench.simulation]\nrays = 4\n[server]\nauth = "required"\n`);
const { env } = place;
const daemon = start(place);
const browser = await browse();

try {
  const address = await daemon.address();
  const link = await oneTimeLink();
  const page = await browser.newPage({ viewport: { width: 1024, height: 900 } });

  step("a stranger is asked for a token and shown nothing");
  await page.goto(address);
  await page.locator("#sign-in").waitFor();
  assert.equal(await page.locator("#stop").count(), 0);

  step("nor the API's contract");
  await page.goto(`${address}api/v1/docs`);
  await page.locator("#sign-in", { hasText: "sign in" }).waitFor();
  assert.equal(await page.locator(".opblock").count(), 0);

  step("the one-time link opens the page and leaves nothing in the address bar");
  await page.goto(link);
  await page.locator(".who", { hasText: "one-time link" }).waitFor({ timeout: 10_000 });
  await page.locator(".axes").waitFor();
  assert.equal(page.url(), address);
  await page.reload();
  await page.locator(".who", { hasText: "one-time link" }).waitFor({ timeout: 10_000 });

  step("the API's contract is shown, with nothing from elsewhere, and can be tried");
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

  step("it can be read, by day and by night");
  for (const [colorScheme, dark] of [
    ["light", false],
    ["dark", true],
  ]) {
    await page.emulateMedia({ colorScheme });
    await page.locator(dark ? "html.dark-mode" : "html:not(.dark-mode)").waitFor();
    await drawn(page);
    const ground = await page.evaluate(() => getComputedStyle(document.documentElement).backgroundColor);
    assert.equal(ground === "rgb(28, 32, 34)", dark, `${ground} by ${colorScheme}`);
    await accessible(page);
  }
  await page.emulateMedia({ colorScheme: "light" });
  assert.deepEqual(complaints, []);
  page.off("console", heard);
  page.off("request", asked);
  await page.goto(address);
  await page.locator(".who", { hasText: "one-time link" }).waitFor({ timeout: 60_000 });

  step("signed out, nothing is left on the screen, control is given back, and the link is dead");
  await page.getByRole("button", { name: "Take control" }).click();
  await page.locator(".lease[data-lease=mine]").waitFor();
  await page.locator("#sign-out").click();
  await page.locator("#sign-in").waitFor();
  assert.equal(await page.locator(".axes").count(), 0);
  await page.goto(link);
  await page.locator("header .problem").waitFor();
  await page.locator("#sign-in").waitFor();

  step("whoever comes by the link to a job's prompts is told that it counts once they have signed in");
  await page.goto("about:blank");
  const job = "01a224ed-9bfe-7727-bfca-cc9e9f537cb7";
  await page.goto(`${address}#/alignment/${job}/confirm_${"0".repeat(64)}`);
  await page.locator("#sign-in #handed").waitFor();
  await page.goto(address);
  await page.locator("#sign-in").waitFor();

  step("a wrong token is told, a right one lets in");
  await page.locator("#sign-in input:focus").waitFor();
  await page.locator("#sign-in input").fill("plenalign_wrong");
  await page.locator("#sign-in button").click();
  await page.locator("#sign-in .problem").waitFor();
  await page.locator("#sign-in input").fill(tokenOf("Vera", "view"));
  await page.locator("#sign-in button").click();
  await page.locator(".who", { hasText: "Vera" }).waitFor({ timeout: 10_000 });
  await page.locator(".lease[data-lease=free]").waitFor();

  step("who may only look is offered no command");
  await page.locator(".axes", { hasText: "You may look and stop" }).waitFor();
  for (const button of await page.locator(".axes .hold, .axes .step, .axes .home").all()) {
    assert(await button.isDisabled());
  }
  assert.equal(await page.getByRole("button", { name: "Take control" }).count(), 0);
  await open(page, "Settings");
  assert.equal(await page.locator(".tokens").count(), 0);
  await open(page, "Alignment");
  assert(await page.locator("#start").isDisabled());

  step("who may look may stop");
  await page.locator("#stop").click();
  await page.locator("#reset").waitFor();
  assert(await page.locator("#reset").isDisabled());

  step("a token that is revoked ends what is shown, and says that it was, also after a reload");
  execFileSync(program, ["token", "revoke", "Vera"], { env });
  const out = page.locator("#out", {
    hasText: /token of Vera was revoked on the daemon’s machine, .*\d:\d\d/,
  });
  await out.waitFor({ timeout: 10_000 });
  assert.equal(await page.locator(".axes, #stop").count(), 0);
  await page.reload();
  await out.waitFor({ timeout: 10_000 });
  await accessible(page);
  await page.screenshot({ path: `${shots}/revoked.png` });

  step("what is made elsewhere, and used, is in the list of tokens without a reload");
  const listed = async (name) => (await page.locator(".token-list li", { hasText: name }).innerText()) ?? "";
  await page.locator("#sign-in input").fill(tokenOf("Eva", "admin"));
  await page.locator("#sign-in button").click();
  await open(page, "Settings");
  await page.locator(".token-list li", { hasText: "Eva" }).waitFor();
  const cat = tokenOf("Cat", "view");
  await page.locator(".token-list li", { hasText: "Cat" }).waitFor();
  assert.match(await listed("Cat"), /Last used never/);
  await fetch(new URL("api/v1/bench", address), { headers: { authorization: `Bearer ${cat}` } });
  await until(async () => !/Last used never/.test(await listed("Cat")), "a token used goes on as never used");

  step("a token is made for a while, by the daemon's clock");
  await page.locator("#token-name").fill("Shift");
  await page.getByRole("button", { name: "8 hours" }).click();
  await page.getByRole("button", { name: "Make a token" }).click();
  await page.locator(".token-list li", { hasText: "Shift" }).waitFor();
  await page.getByRole("button", { name: "I have kept it" }).click();
  const { tokens } = await page.evaluate(async () => (await fetch("api/v1/tokens")).json());
  const lasts = Date.parse(tokens.find(({ name }) => name === "Shift").expires_at) - Date.now();
  assert(Math.abs(lasts / 3_600_000 - 8) < 0.1, `it lasts ${lasts} ms`);
  assert.match(await listed("Shift"), /Ends .*\d:\d\d/);
  await page.locator("#sign-out").click();

  step("a token that expires ends what is shown, and says that it has and when, also after a reload");
  const admin = tokenOf("Ada", "admin");
  await page.locator("#sign-in input").fill(admin);
  await page.locator("#sign-in button").click();
  await page.getByRole("button", { name: "Take control" }).click();
  await page.locator(".lease[data-lease=mine]").waitFor();
  await page.context().clearCookies();
  await page.reload();
  const answer = await fetch(new URL("api/v1/tokens", address), {
    method: "POST",
    headers: { authorization: `Bearer ${admin}`, "content-type": "application/json" },
    body: JSON.stringify({
      name: "Brief",
      scope: "view",
      expires_at: new Date(Date.now() + 8000).toISOString(),
    }),
  });
  assert.equal(answer.status, 201);
  await page.locator("#sign-in input").fill((await answer.json()).secret);
  await page.locator("#sign-in button").click();
  await page.locator(".who", { hasText: "Brief" }).waitFor({ timeout: 10_000 });
  // Another had control on this page, and has it still: not who may only look.
  await page.locator(".lease[data-lease=others]").waitFor();
  assert.equal(await page.evaluate(() => sessionStorage.getItem("plenalign.lease.key")), null);
  assert.equal(await page.locator(".control-lost").count(), 0, "it is told how another's control ended");
  const over = page.locator("#out", { hasText: /token of Brief has expired, .*\d:\d\d/ });
  await over.waitFor({ timeout: 20_000 });
  assert.equal(await page.locator(".axes, #stop").count(), 0);
  await page.reload();
  await over.waitFor({ timeout: 10_000 });
} finally {
  await browser.close();
  daemon.process.kill("SIGKILL");
  place.remove();
}

/** A token made on the command line. */
function tokenOf(name, scope) {
  const asked = ["token", "create", "--name", name, "--scope", scope];
  return execFileSync(program, asked, { env, stdio: ["ignore", "pipe", "ignore"] })
    .toString()
    .trim();
}

/** The link that the daemon puts into its state folder. */
async function oneTimeLink() {
  const file = join(place.state, "login-url");
  await until(() => existsSync(file), "the daemon made no one-time link");
  return readFileSync(file, "utf8").trim();
}
