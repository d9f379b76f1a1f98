import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LeaseKeeper, type Send } from "../src/daemon/lease";

interface Call {
  what: string;
  key: string | undefined;
  body: unknown;
}

/** A daemon that gives leases away, and refuses keys that are not the newest. */
function daemon() {
  const calls: Call[] = [];
  const state = { key: null as string | null, given: 0, reachable: true };
  const refused = (status: number) => ({
    ok: false as const,
    problem: { type: "about:blank", title: "refused", status, detail: "" },
  });
  const send: Send = <T>(method: string, path: string, body?: unknown, key?: string) => {
    const what = `${method} ${path.replace("/api/v1/", "")}`;
    calls.push({ what, key, body });
    const answer = () => {
      if (!state.reachable) return refused(0);
      if (what === "POST lease" && state.key !== null) return refused(409);
      if (what === "POST lease" || what === "POST lease/takeover") {
        state.given += 1;
        state.key = `key${state.given}`;
        return { ok: true as const, value: { key: state.key, lease: { id: `id${state.given}` } } as T };
      }
      if (key !== state.key) return refused(412);
      if (what === "DELETE lease") state.key = null;
      return { ok: true as const, value: null as T };
    };
    return Promise.resolve(answer());
  };
  return { calls, state, send };
}

function storage() {
  const kept = new Map<string, string>();
  return {
    getItem: (name: string) => kept.get(name) ?? null,
    setItem: (name: string, value: string) => void kept.set(name, value),
    removeItem: (name: string) => void kept.delete(name),
  };
}

const keeper = (send: Send) => new LeaseKeeper(send, () => "Ana", storage());
const beats = (calls: Call[]) => calls.filter((call) => call.what === "POST lease/heartbeat").length;

describe("the lease", () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it("is no other's while it is being asked for, whichever comes first, the answer or the bench's state", async () => {
    const { send } = daemon();
    const lease = keeper(send);
    const taken = lease.take();
    expect(lease.other({ id: "id1", owner: "Ana" })).toBeNull();
    expect(lease.other({ id: "id9", owner: "Ben" })).toBe("Ben");
    await taken;
    expect([lease.isMine({ id: "id1" }), lease.other({ id: "id9", owner: "Ana" })]).toEqual([true, "Ana"]);
  });

  it("is kept up whatever the browser's clock is set to", async () => {
    const { send, calls } = daemon();
    await keeper(send).take();
    vi.setSystemTime(Date.now() - 3_600_000);
    await vi.advanceTimersByTimeAsync(30_000);
    expect(beats(calls)).toBe(3);
  });

  it("is lost to another, or by itself, and not by being given back", async () => {
    const { send } = daemon();
    const lease = keeper(send);
    expect(lease.heard({ id: "x", owner: "Ben" })).toBeNull();
    await lease.take();
    // What was on its way when it was taken.
    expect(lease.heard(null)).toBeNull();
    expect(lease.heard({ id: "id1", owner: "Ana" })).toBe("mine");
    expect(lease.heard({ id: "x", owner: "Ben" })).toEqual({ to: "Ben", job: false });
    expect([lease.key, lease.heard({ id: "x", owner: "Ben" })]).toEqual([null, null]);
    await lease.takeOver();
    expect(lease.heard({ id: "id2", owner: "Ana" })).toBe("mine");
    expect(lease.heard(null)).toEqual({ to: null, job: false });
    await lease.takeOver();
    expect(lease.heard({ id: "id3", owner: "Ana" })).toBe("mine");
    await lease.release();
    expect(lease.heard(null)).toBeNull();
    await lease.take();
    expect(lease.heard({ id: "id4", owner: "Ana", job: "one" })).toBe("mine");
    expect(lease.heard({ id: "x", owner: "Ben", job: null })).toEqual({ to: "Ben", job: true });
  });

  it("is lost to another where a command was refused before that was heard", async () => {
    const { state, send } = daemon();
    const lease = keeper(send);
    await lease.take();
    expect(lease.heard({ id: "id1", owner: "Ana" })).toBe("mine");
    state.key = null;
    expect((await lease.repeat("POST", "/api/v1/axes/e/jog", {})).ok).toBe(false);
    expect([lease.key, lease.heard({ id: "x", owner: "Ben" })]).toEqual([null, { to: "Ben", job: false }]);
    expect(lease.heard({ id: "x", owner: "Ben" })).toBeNull();
  });

  it("is not lost with the one before that ran out", async () => {
    const { state, send } = daemon();
    const lease = keeper(send);
    await lease.take();
    expect(lease.heard({ id: "id1", owner: "Ana" })).toBe("mine");
    state.key = null;
    expect((await lease.command("POST", "/api/v1/axes/e/home")).ok).toBe(true);
    // What was on its way while the other was granted.
    expect(lease.heard(null)).toBeNull();
    expect(lease.key).not.toBeNull();
    expect(lease.heard({ id: "id2", owner: "Ana" })).toBe("mine");
  });

  it("is taken under a name and renewed well within its time to live", async () => {
    const { calls, send } = daemon();
    const lease = keeper(send);
    expect(await lease.take()).toBeNull();
    const { owner, ttl_s } = calls[0]?.body as { owner: string; ttl_s: number };
    expect(owner).toBe("Ana");
    await vi.advanceTimersByTimeAsync(ttl_s * 1000);
    expect(beats(calls)).toBeGreaterThanOrEqual(2);
    expect(calls.filter((call) => call.what.endsWith("heartbeat")).every((call) => call.key === "key1")).toBe(
      true,
    );
    expect(lease.isMine({ id: "id1" })).toBe(true);
    expect(lease.isMine({ id: "id2" })).toBe(false);
  });

  it("is kept through a connection lost, and given up where another has it", async () => {
    const { calls, state, send } = daemon();
    const lease = keeper(send);
    await lease.take();
    state.reachable = false;
    await vi.advanceTimersByTimeAsync(10_000);
    expect(lease.key).toBe("key1");
    state.reachable = true;
    state.key = "somebody's";
    await vi.advanceTimersByTimeAsync(10_000);
    expect(lease.key).toBeNull();
    const before = beats(calls);
    await vi.advanceTimersByTimeAsync(60_000);
    expect(beats(calls)).toBe(before);
  });

  it("is renewed by signs of life where the page's own timers are slowed down, and no more often than it needs", async () => {
    const { calls, send } = daemon();
    vi.stubGlobal("setInterval", () => 0);
    const lease = keeper(send);
    await lease.take();
    for (let second = 0; second < 60; second += 1) {
      await vi.advanceTimersByTimeAsync(1000);
      lease.due();
    }
    vi.unstubAllGlobals();
    expect(beats(calls)).toBe(6);
    await lease.release();
    lease.due();
    expect(beats(calls)).toBe(6);
  });

  it("is not renewed any more once given back", async () => {
    const { calls, state, send } = daemon();
    const lease = keeper(send);
    await lease.take();
    await lease.release();
    expect(state.key).toBeNull();
    await vi.advanceTimersByTimeAsync(60_000);
    expect(beats(calls)).toBe(0);
  });

  it("is not lost while it is being given back, whatever is still on its way", async () => {
    const { send } = daemon();
    const lease = keeper(send);
    await lease.take();
    const mine = { id: "id1", owner: "Ana" };
    expect(lease.heard(mine)).toBe("mine");
    const given = lease.release();
    expect([lease.heard(mine), lease.heard(null)]).toEqual([null, null]);
    expect(await given).toBeNull();
    expect(lease.heard({ id: "x", owner: "Ben" })).toBeNull();
  });

  it("is still had where it cannot be given back, and that is said", async () => {
    const { state, send } = daemon();
    const lease = keeper(send);
    await lease.take();
    expect(lease.heard({ id: "id1", owner: "Ana" })).toBe("mine");
    state.reachable = false;
    expect((await lease.release())?.status).toBe(0);
    expect(lease.isMine({ id: "id1" })).toBe(true);
    expect(lease.heard(null)).toEqual({ to: null, job: false });
  });

  it("is taken over from whoever has it", async () => {
    const { state, send } = daemon();
    state.key = "somebody's";
    const lease = keeper(send);
    expect((await lease.take())?.status).toBe(409);
    expect(await lease.takeOver()).toBeNull();
    expect(lease.key).toBe("key1");
  });

  it("is taken anew for a command where it had run out", async () => {
    const { calls, state, send } = daemon();
    const lease = keeper(send);
    await lease.take();
    state.key = null;
    expect((await lease.command("POST", "/api/v1/axes/e/home")).ok).toBe(true);
    expect(calls.map((call) => call.what)).toEqual([
      "POST lease",
      "POST axes/e/home",
      "POST lease",
      "POST axes/e/home",
    ]);
  });

  it("is not taken anew for a jog that goes on: whoever took it over finds the axis still", async () => {
    const { calls, state, send } = daemon();
    const lease = keeper(send);
    expect((await lease.repeat("POST", "/api/v1/axes/e/jog", {})).ok).toBe(true);
    state.key = null;
    const refused = await lease.repeat("POST", "/api/v1/axes/e/jog", {});
    expect(refused.ok ? 0 : refused.problem.status).toBe(412);
    expect(calls.map((call) => call.what)).toEqual(["POST lease", "POST axes/e/jog", "POST axes/e/jog"]);
    expect(lease.key).toBeNull();
  });
});
