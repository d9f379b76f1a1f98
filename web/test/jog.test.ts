import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { BEAT_MS, Jog, LAPSE_MS, TURN_MS, type JogCalls, type Press } from "../src/bench/jog";
import { MOVING } from "../src/daemon/over";
import type { Problem } from "../src/daemon/wire";

const press: Press = { axis: "e", towards: "low", speedMmPerS: 0.5 };
const refusal: Problem = { type: "urn:plenalign:problem:limit", title: "t", status: 409, detail: "d" };

function held(go: () => Promise<Problem | null> = () => Promise.resolve(null)) {
  const told: string[] = [];
  const names: string[] = [];
  const calls: JogCalls = {
    go: (asked, name) => {
      told.push(`go ${asked.axis} ${asked.towards}`);
      names.push(name);
      return go();
    },
    end: (axis) => {
      told.push(`end ${axis}`);
      return Promise.resolve(null);
    },
    failed: (problem) => told.push(`failed ${problem.status}`),
    changed: () => undefined,
  };
  return { jog: new Jog(calls), told, names };
}

describe("press and hold", () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it("is told at once and again and again, and ended once", async () => {
    const { jog, told } = held();
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(3 * BEAT_MS + 10);
    expect(told).toEqual(["go e low", "go e low", "go e low", "go e low"]);
    jog.release();
    await vi.advanceTimersByTimeAsync(10 * BEAT_MS);
    expect(told.slice(4)).toEqual(["end e"]);
    jog.release();
    expect(told).toHaveLength(5);
  });

  it("is over where nothing was told for a while: the computer slept, or the answer was long in coming", async () => {
    const asleep = held();
    asleep.jog.begin(press);
    await vi.advanceTimersByTimeAsync(BEAT_MS + 10);
    vi.setSystemTime(Date.now() + LAPSE_MS);
    await vi.advanceTimersByTimeAsync(5 * BEAT_MS);
    expect(asleep.told).toEqual(["go e low", "go e low", "end e"]);
    expect(asleep.jog.pressed).toBeNull();

    let answer: () => void = () => undefined;
    const late = held(() => new Promise((resolve) => (answer = () => resolve(null))));
    late.jog.begin(press);
    await vi.advanceTimersByTimeAsync(LAPSE_MS + BEAT_MS);
    answer();
    await vi.advanceTimersByTimeAsync(5 * BEAT_MS);
    expect(late.told).toEqual(["go e low", "end e"]);
  });

  it("has one name for as long as it lasts, and another the next time", async () => {
    const { jog, names } = held();
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(3 * BEAT_MS + 10);
    jog.release();
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(10);
    const [first, ...others] = names;
    expect(first).toMatch(/^\S{8,64}$/);
    expect(others.slice(0, 3)).toEqual([first, first, first]);
    expect(others[3]).not.toBe(first);
  });

  it("does not begin before the press before it has ended", async () => {
    const told: string[] = [];
    let ended: () => void = () => undefined;
    const jog = new Jog({
      go: (asked, name) => {
        told.push(`go ${asked.axis} ${name}`);
        return Promise.resolve(null);
      },
      end: () => {
        told.push("end");
        return new Promise((resolve) => (ended = () => resolve(null)));
      },
      failed: () => undefined,
      changed: () => undefined,
    });
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(10);
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(3 * BEAT_MS);
    expect(told.slice(1)).toEqual(["end"]);
    ended();
    await vi.advanceTimersByTimeAsync(10);
    expect(told).toHaveLength(3);
    expect(told[2]).not.toBe(told[0]);
  });

  it("does not begin again by itself once the daemon has refused it", async () => {
    let answer: Problem | null = null;
    const { jog, told } = held(() => Promise.resolve(answer));
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(BEAT_MS + 10);
    answer = { ...refusal, type: "urn:plenalign:problem:press-ended" };
    await vi.advanceTimersByTimeAsync(BEAT_MS);
    answer = null;
    const before = told.length;
    await vi.advanceTimersByTimeAsync(10 * BEAT_MS);
    expect(told.slice(before)).toEqual([]);
    expect(jog.pressed).toBeNull();
  });

  it("beats at least twice in the time that the deadman waits", () => {
    expect(BEAT_MS).toBeLessThanOrEqual(150);
  });

  it("does not pile words up behind a slow answer", async () => {
    const { jog, told } = held(() => new Promise((resolve) => setTimeout(() => resolve(null), 5 * BEAT_MS)));
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(4 * BEAT_MS);
    expect(told).toEqual(["go e low"]);
    await vi.advanceTimersByTimeAsync(2 * BEAT_MS);
    expect(told).toEqual(["go e low", "go e low"]);
  });

  it("takes back a word that was on its way when it was let go", async () => {
    const { jog, told } = held(() => new Promise((resolve) => setTimeout(() => resolve(null), 50)));
    jog.begin(press);
    jog.release();
    await vi.advanceTimersByTimeAsync(1000);
    expect(told).toEqual(["go e low", "end e", "end e"]);
  });

  it("ends with a refusal, and says so once", async () => {
    const { jog, told } = held(() => Promise.resolve(refusal));
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(10 * BEAT_MS);
    expect(told).toEqual(["go e low", "end e", "failed 409"]);
    expect(jog.pressed).toBeNull();
  });

  it("waits for what the press before it moved to stand, no longer than that takes, and for nothing else", async () => {
    const moving: Problem = { ...refusal, type: MOVING };
    let answer: Problem | null = null;
    const turned = held(() => Promise.resolve(answer));
    turned.jog.begin(press);
    await vi.advanceTimersByTimeAsync(10);
    turned.jog.release();
    await vi.advanceTimersByTimeAsync(10);
    turned.told.length = 0;
    answer = moving;
    turned.jog.begin(press);
    await vi.advanceTimersByTimeAsync(2 * BEAT_MS + 10);
    answer = null;
    await vi.advanceTimersByTimeAsync(BEAT_MS);
    expect(turned.told).toEqual(["go e low", "go e low", "go e low", "go e low"]);
    expect(turned.jog.pressed).toBe(press);
    // Once it moves, another motion is news.
    answer = moving;
    await vi.advanceTimersByTimeAsync(BEAT_MS);
    expect(turned.told.slice(4)).toEqual(["go e low", "end e", "failed 409"]);

    const long = held(() => Promise.resolve(long.names.length > 1 ? moving : null));
    long.jog.begin({ ...press });
    await vi.advanceTimersByTimeAsync(10);
    long.jog.begin(press);
    await vi.advanceTimersByTimeAsync(TURN_MS - 10);
    expect(long.jog.pressed).toBe(press);
    await vi.advanceTimersByTimeAsync(2 * BEAT_MS);
    expect(long.told.slice(-2)).toEqual(["end e", "failed 409"]);

    // A move that was ordered, say, which has an axis stand for a moment before its last leg.
    const other = held(() => Promise.resolve(moving));
    other.jog.begin(press);
    await vi.advanceTimersByTimeAsync(10);
    expect(other.told).toEqual(["go e low", "end e", "failed 409"]);
  });

  it("lets one press go before another begins", async () => {
    const { jog, told } = held();
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(10);
    jog.begin({ ...press, towards: "high" });
    await vi.advanceTimersByTimeAsync(10);
    expect(told).toEqual(["go e low", "end e", "go e high"]);
    expect(jog.pressed?.towards).toBe("high");
  });

  it("waits for an axis to stand from when the end of the press before is answered", async () => {
    const told: string[] = [];
    let stands = false;
    let answered = () => undefined as void;
    const moving: Problem = { ...refusal, type: MOVING };
    const jog = new Jog({
      go: () => {
        told.push("go");
        return Promise.resolve(told.length === 1 || stands ? null : moving);
      },
      end: () => new Promise((resolve) => (answered = () => resolve(null))),
      failed: () => told.push("failed"),
      changed: () => undefined,
    });
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(10);
    jog.begin(press);
    await vi.advanceTimersByTimeAsync(TURN_MS - BEAT_MS);
    answered();
    // Longer than a press waits, but not after the answer.
    await vi.advanceTimersByTimeAsync(3 * BEAT_MS);
    expect(jog.pressed).not.toBeNull();
    stands = true;
    await vi.advanceTimersByTimeAsync(2 * BEAT_MS);
    expect(told).not.toContain("failed");
    jog.release();
  });
});
