import { expect, it } from "vitest";
import { isNews, SPEAK_MS, type Said } from "../src/speech";
import type { Reading } from "../src/reading";

const reading = (differencePx: number, direction: Reading["direction"]) => ({
  sigmaPx: 0.01,
  differencePx,
  direction,
});
const said: Said = { differencePx: 1, direction: "larger", at: 0 };

it("says the first reading, and then what is news, at its leisure", () => {
  expect(isNews(null, reading(1, "larger"), 0)).toBe(true);
  expect(isNews(said, reading(-1, "smaller"), SPEAK_MS - 1)).toBe(false);
  expect(isNews(said, reading(-1, "smaller"), SPEAK_MS)).toBe(true);
  expect(isNews(said, reading(0.5, "larger"), SPEAK_MS)).toBe(true);
});

it("does not repeat what differs by scatter, or in its last digit", () => {
  expect(isNews(said, reading(1.05, "larger"), 60_000)).toBe(false);
  const near: Said = { differencePx: 0.05, direction: "larger", at: 0 };
  expect(isNews(near, reading(0.03, "larger"), 60_000)).toBe(false);
  expect(isNews(near, reading(0.09, "larger"), 60_000)).toBe(true);
  const there: Said = { differencePx: 0.001, direction: "there", at: 0 };
  expect(isNews(there, reading(-0.015, "there"), 60_000)).toBe(false);
});

it("says once that the spacing is lost, and then what is found", () => {
  // At once: what was said before holds no longer.
  expect(isNews(said, null, 1)).toBe(true);
  expect(isNews(said, null, SPEAK_MS)).toBe(true);
  const lost: Said = { differencePx: 0, direction: null, at: 0 };
  expect(isNews(lost, null, 60_000)).toBe(false);
  expect(isNews(lost, reading(0, "there"), SPEAK_MS)).toBe(true);
});

it("says at once, and once, that it is of two boards", () => {
  expect(isNews(said, reading(0.6, "two_boards"), 1)).toBe(true);
  const two: Said = { differencePx: 0.6, direction: "two_boards", at: 0 };
  expect(isNews(two, reading(0.9, "two_boards"), 60_000)).toBe(false);
});
