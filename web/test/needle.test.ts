import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { Needle } from "../src/meter/needle";
import { Rate } from "../src/browser/rate";

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("requestAnimationFrame", (act: () => void) => setTimeout(act, 16));
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("is drawn once a screen's frame at most, however many readings come, and only where it is shown", () => {
  const needle = new Needle();
  let drawn = 0;
  needle.moved();
  vi.advanceTimersByTime(100);
  const leave = needle.follow(() => (drawn += 1));
  for (let ms = 0; ms < 1000; ms += 4) {
    needle.moved();
    vi.advanceTimersByTime(4);
  }
  expect(drawn).toBeGreaterThan(25);
  expect(drawn).toBeLessThanOrEqual(63);
  expect(needle.rate).toBeGreaterThan(100);
  vi.advanceTimersByTime(100);
  const before = drawn;
  needle.moved();
  vi.advanceTimersByTime(100);
  expect(drawn).toBe(before + 1);
  leave();
  needle.moved();
  vi.advanceTimersByTime(100);
  expect(drawn).toBe(before + 1);
});

it("tells a rate over the last two seconds", () => {
  const rate = new Rate();
  for (let at = 0; at < 3000; at += 100) rate.note(at);
  expect(rate.at(2999)).toBe(10);
  expect(rate.at(10_000)).toBe(0);
  rate.note(11_000);
  rate.forget();
  expect(rate.at(11_000)).toBe(0);
});
