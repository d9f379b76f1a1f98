import { describe, expect, it } from "vitest";
import { receive, receiveReading } from "../src/received";
import { initial, turnOf, type State } from "../src/state";
import { toneNow, toneOf } from "../src/meter/tone";
import { frameReading, job, lostReading, snapshot } from "./fixtures";

const off = (differencePx: number, direction: "larger" | "smaller" | "there" | "unsure") =>
  toneOf({ differencePx, direction });

describe("the tone", () => {
  it("is higher where the spacing is too large, lower where it is too small", () => {
    expect(off(0, "there").hertz).toBe(440);
    expect(off(10, "larger").hertz).toBeCloseTo(880);
    expect(off(-10, "smaller").hertz).toBeCloseTo(220);
    expect(off(0.1, "larger").hertz).toBeGreaterThan(off(0.03, "larger").hertz);
  });

  it("pulses faster the nearer it is, and is steady only where a job would accept it", () => {
    const pulses = [5, 1, 0.2, 0.03].map((px) => off(px, "larger").pulses ?? 0);
    expect(pulses).toEqual([...pulses].sort((a, b) => a - b));
    expect(off(-0.2, "smaller").pulses).toBe(off(0.2, "larger").pulses);
    expect(off(0.001, "unsure").pulses).toBeGreaterThan(11);
    expect(off(0.01, "there").pulses).toBeNull();
  });
});

describe("what is sounded", () => {
  const at = Date.parse("2026-01-01T00:00:10Z");
  const bench = (jobs: Parameters<typeof snapshot>[1] = []): State => ({
    ...receive(initial, snapshot(5, jobs), at),
    link: "open",
    tone: true,
  });
  const read = (state: State) => receiveReading(state, frameReading(19.8, at), at);

  it("is the newest reading, and nothing where that is old or lost, where a job moves, or nobody wants it", () => {
    const state = read(bench());
    expect(toneNow(state, at)?.hertz).toBeGreaterThan(440);
    expect(toneNow({ ...state, tone: false }, at)).toBeNull();
    expect(toneNow({ ...state, link: "lost" }, at)).toBeNull();
    expect(toneNow(state, at + 60_000)).toBeNull();
    expect(toneNow(receiveReading(state, lostReading("nothing matches", at), at), at)).toBeNull();
    expect(toneNow(read(bench([job("a", 1)])), at)).toBeNull();
    expect(toneNow(read(bench([job("a", 1, "converged")])), at)).not.toBeNull();
  });

  it("calls at each prompt", () => {
    const waiting = (number: number) => ({
      ...job("a", number, "waiting_for_operator"),
      operator_step: { name: "white_frame", instruction: "Hold a diffuser before the lens.", number },
    });
    expect(turnOf(bench([job("a", 1)]))).toBeNull();
    expect(turnOf(bench([waiting(1)]))).not.toBe(turnOf(bench([waiting(2)])));
  });
});
