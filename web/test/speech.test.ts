import { expect, it } from "vitest";
import { isNews, SPEAK_MS, standing, type Said } from "../src/meter/speech";
import type { Reading } from "../src/meter/reading";

const reading = (differencePx: number, direction: Reading["direction"]) => ({
  sigmaPx: 0.01,
  differencePx,
  direction,
});
const order = "Spacing too large, +1.00 pixels. Move the camera 0.30 mm away";
const said: Said = { text: order, differencePx: 1, direction: "larger", at: 0 };

it("says the first reading, and then what is news, at its leisure", () => {
  expect(isNews(null, reading(1, "larger"), order, 0)).toBe(true);
  expect(isNews(said, reading(-1, "smaller"), order, SPEAK_MS - 1)).toBe(false);
  expect(isNews(said, reading(-1, "smaller"), order, SPEAK_MS)).toBe(true);
  expect(isNews(said, reading(0.5, "larger"), order, SPEAK_MS)).toBe(true);
});

it("does not repeat what differs by scatter, or in its last digit", () => {
  expect(isNews(said, reading(1.05, "larger"), order, 60_000)).toBe(false);
  const near: Said = { text: order, differencePx: 0.05, direction: "larger", at: 0 };
  expect(isNews(near, reading(0.03, "larger"), order, 60_000)).toBe(false);
  expect(isNews(near, reading(0.09, "larger"), order, 60_000)).toBe(true);
  const there: Said = { text: order, differencePx: 0.001, direction: "there", at: 0 };
  expect(isNews(there, reading(-0.015, "there"), order, 60_000)).toBe(false);
});

it("says once that the spacing is lost, and then what is found", () => {
  // At once: what was said before holds no longer.
  expect(isNews(said, null, order, 1)).toBe(true);
  expect(isNews(said, null, order, SPEAK_MS)).toBe(true);
  const lost: Said = { text: order, differencePx: 0, direction: null, at: 0 };
  expect(isNews(lost, null, order, 60_000)).toBe(false);
  expect(isNews(lost, reading(0, "there"), order, SPEAK_MS)).toBe(true);
});

it("says at once, and once, that it is of two boards", () => {
  expect(isNews(said, reading(0.6, "two_boards"), order, 1)).toBe(true);
  const two: Said = { text: order, differencePx: 0.6, direction: "two_boards", at: 0 };
  expect(isNews(two, reading(0.9, "two_boards"), order, 60_000)).toBe(false);
});

it("says what else the meter tells to do, whatever its figures", () => {
  const same = order.replace("0.30", "0.31").replace("1.00", "1.01");
  expect(isNews(said, reading(1.01, "larger"), same, 60_000)).toBe(false);
  // A job has begun, or the bench is stopped: nothing is to be moved any more.
  const job = "Spacing too large, +1.00 pixels. A job is under way";
  expect(isNews(said, reading(1, "larger"), job, SPEAK_MS)).toBe(true);
  expect(isNews(said, reading(1, "larger"), job, SPEAK_MS - 1)).toBe(false);
});

it("leaves nothing to be come upon that the meter said a while ago", () => {
  expect([standing(said, SPEAK_MS - 1), standing(said, SPEAK_MS), standing(null, 0)]).toEqual([
    order,
    "",
    "",
  ]);
});
