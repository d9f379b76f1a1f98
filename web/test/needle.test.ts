import { expect, it } from "vitest";
import { Needle } from "../src/needle";
import { Rate } from "../src/rate";

it("is drawn once a screen's frame, however many readings come, and by whoever shows it", () => {
  const frames: (() => void)[] = [];
  const needle = new Needle((act) => void frames.push(act));
  let drawn = 0;
  needle.moved();
  expect(frames).toHaveLength(0);
  const leave = needle.follow(() => (drawn += 1));
  for (let reading = 0; reading < 5; reading += 1) needle.moved();
  expect([frames.length, drawn]).toEqual([1, 0]);
  frames.shift()?.();
  expect(drawn).toBe(1);
  needle.moved();
  leave();
  frames.shift()?.();
  expect(drawn).toBe(1);
  expect(needle.rate).toBeGreaterThan(0);
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
