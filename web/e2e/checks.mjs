// What is asserted of a page however it came to be as it is: its lengths, its labels, itself on paper.

import assert from "node:assert/strict";
import { open, shots } from "./harness.mjs";
import { drawn } from "./until.mjs";

const A4 = { width: 794, height: 1123 };

/** Chooses the unit of lengths. */
export async function chooseUnit(page, unit) {
  await open(page, "Settings");
  await page.locator(".preferences").getByRole("button", { name: unit, exact: true }).click();
}

/** Whether what is shown has its lengths in the unit chosen, and none in the other. */
export async function lengthsIn(page, unit, where = "main") {
  const other = unit === "mm" ? "µm" : "mm";
  const text = await page.locator(where).innerText();
  const labels = await page
    .locator(`${where} [aria-label], ${where} [placeholder]`)
    .evaluateAll((all) =>
      all.map((one) => `${one.getAttribute("aria-label")} ${one.getAttribute("placeholder")}`),
    );
  const all = [text, ...labels].join("\n");
  assert(all.includes(unit), `no ${unit} in: ${all}`);
  const wrong = all.split("\n").filter((line) => new RegExp(`(^|[\\s\\d,])${other}($|[\\s,:;.])`).test(line));
  assert.deepEqual(wrong, [], `lengths in ${other}`);
}

/** Whether the words of a drawing are inside of it, and none over another. */
export async function labelled(drawing, least) {
  const found = await drawing.evaluate((svg) => {
    const box = (element) => {
      const { left, top, right, bottom } = element.getBoundingClientRect();
      return { left, top, right, bottom, text: element.textContent };
    };
    return { all: box(svg), texts: [...svg.querySelectorAll("text")].map(box) };
  });
  const { all, texts } = found;
  const words = texts.map(({ text }) => text).join(", ");
  assert(texts.length >= least, `only ${words}`);
  for (const [index, one] of texts.entries()) {
    const within =
      one.left >= all.left && one.right <= all.right && one.top >= all.top && one.bottom <= all.bottom;
    assert(within, `${one.text} is half outside`);
    for (const other of texts.slice(index + 1)) {
      const apart =
        one.right <= other.left ||
        other.right <= one.left ||
        one.bottom <= other.top ||
        other.bottom <= one.top;
      assert(apart, `${one.text} over ${other.text}, of ${words}`);
    }
  }
}

/** The page on paper, printed from a dark screen: nothing to be pressed, nothing cut off, ink on white. */
export async function printed(page, name) {
  const before = page.viewportSize();
  await page.emulateMedia({ media: "print", colorScheme: "dark" });
  await page.setViewportSize(A4);
  await drawn(page);
  const seen = await page.evaluate(() => {
    const shown = (element) => element.getClientRects().length > 0;
    const pressable = [...document.querySelectorAll("button:not([aria-pressed=true]), nav, select")];
    const wide = [...document.querySelectorAll("main table, main .chart canvas")].filter(shown);
    return {
      pressed: pressable.filter(shown).map((element) => element.textContent),
      cut: wide
        .filter((element) => element.getBoundingClientRect().right > innerWidth + 1)
        .map((element) => element.closest("section").className),
      ink: getComputedStyle(document.body).color,
      paper: getComputedStyle(document.body).backgroundColor,
    };
  });
  await page.screenshot({ path: `${shots}/${name}-paper.png`, fullPage: true });
  const pdf = await page.pdf({ path: `${shots}/${name}.pdf`, preferCSSPageSize: true });
  await page.emulateMedia({ media: "screen", colorScheme: "light" });
  await page.setViewportSize(before);
  assert.deepEqual(seen, { pressed: [], cut: [], ink: "rgb(20, 24, 29)", paper: "rgb(255, 255, 255)" });
  assert.equal(pdf.subarray(0, 5).toString(), "%PDF-");
}
