import { expect, it } from "vitest";
import { Belongings } from "../src/daemon/belongings";
import { ConfirmKeys } from "../src/daemon/confirm-key";
import { LeaseKeeper, type Send } from "../src/daemon/lease";
import type { Session } from "../src/daemon/wire";

const named = (name: string, signed_in = true): Session => ({
  ...{ name, signed_in, scope: "control", demanded: signed_in },
});

/** A tab in which somebody has control, and a job's confirm key. */
async function tab() {
  const kept = new Map<string, string>();
  const storage = {
    getItem: (name: string) => kept.get(name) ?? null,
    setItem: (name: string, value: string) => void kept.set(name, value),
    removeItem: (name: string) => void kept.delete(name),
  };
  const send: Send = <T>() =>
    Promise.resolve({ ok: true as const, value: { key: "k", lease: { id: "id1" } } as T });
  const lease = new LeaseKeeper(send, () => "Ana", storage);
  const keys = new ConfirmKeys(storage);
  const belongings = new Belongings(storage, () => {
    lease.abandon();
    keys.forget();
  });
  belongings.cameIn(named("Ana"));
  await lease.take();
  keys.keep({ job: "j", key: "c" });
  expect(lease.heard({ id: "id1", owner: "Ana" })).toBe("mine");
  const holds = () => [lease.key, keys.of("j")];
  return { lease, belongings, holds };
}

it("keeps who signs in again what they had while a job goes on", async () => {
  const { lease, belongings, holds } = await tab();
  lease.left();
  expect(belongings.cameIn(named("Ana"))).toBe(false);
  expect(holds()).toEqual(["k", "c"]);
  expect(lease.heard({ id: "id1", owner: "Ana" })).toBe("mine");
});

it("leaves nothing of it to who signs in next, and tells them nothing of how it ended", async () => {
  const { lease, belongings, holds } = await tab();
  lease.left();
  // What became of it between the two.
  expect(lease.heard({ id: "x", owner: "Ben" })).toBeNull();
  expect(belongings.cameIn(named("Vera"))).toBe(true);
  expect(holds()).toEqual([null, null]);
  expect(lease.isMine({ id: "id1" })).toBe(false);
  expect(lease.heard(null)).toBeNull();
  // Nor is it back with who was there before.
  expect(belongings.cameIn(named("Ana"))).toBe(true);
  expect(holds()).toEqual([null, null]);
});

it("takes nothing from who makes the first token, before which everybody is the same", async () => {
  const { belongings, holds } = await tab();
  expect(belongings.cameIn(named("everybody", false))).toBe(false);
  expect(holds()).toEqual(["k", "c"]);
});
