import { describe, expect, it } from "vitest";
import { Awake } from "../src/browser/awake";

class Lock {
  released = false;
  release(): Promise<void> {
    this.released = true;
    return Promise.resolve();
  }
}

describe("the screen", () => {
  it("is kept awake by one lock, got anew where the browser has ended it, and let go of", async () => {
    const locks: Lock[] = [];
    const awake = new Awake(() => {
      locks.push(new Lock());
      return Promise.resolve(locks[locks.length - 1] as unknown as WakeLockSentinel);
    });
    for (const now of [0, 1, 2]) await awake.want(true, now);
    expect(locks.length).toBe(1);
    await locks[0]?.release();
    await awake.want(true, 3);
    expect(locks.map(({ released }) => released)).toEqual([true, false]);
    await awake.want(false, 4);
    expect(locks[1]?.released).toBe(true);
    await awake.want(false, 5);
    expect(locks.length).toBe(2);
  });

  it("is asked for again, not at once, where it was refused; and not at all where there is nothing to ask", async () => {
    let asked = 0;
    const awake = new Awake(() => {
      asked += 1;
      return Promise.reject(new Error("the battery is low"));
    });
    for (const now of [0, 9000, 11_000]) await awake.want(true, now);
    expect(asked).toBe(2);
    const none = new Awake(undefined);
    await none.want(true, 0);
    expect(none.possible).toBe(false);
  });
});
