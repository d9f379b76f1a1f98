import { describe, expect, it } from "vitest";
import { ConfirmKeys, isBrokenLink, keyOfAddress, keyWithin, linkWith } from "../src/daemon/confirm-key";
import { routeOf } from "../src/browser/route";

const job = "0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11";
const key = `confirm_${"0123456789abcdef".repeat(4)}`;

function storage() {
  const kept = new Map<string, string>();
  return {
    kept,
    getItem: (name: string) => kept.get(name) ?? null,
    setItem: (name: string, value: string) => void kept.set(name, value),
    removeItem: (name: string) => void kept.delete(name),
  };
}

describe("the confirm key", () => {
  it("goes in a link behind the #, where no daemon sees it, and comes out of it again", () => {
    const link = new URL(linkWith("http://bench.example:8080/", { job, key }));
    expect(`${link.pathname}${link.search}`).toBe("/");
    expect(keyOfAddress(link.hash)).toEqual({ job, key });
    expect(keyWithin(` ${link.href} `)).toBe(key);
    expect(keyWithin(key)).toBe(key);
  });

  it("is in no other address", () => {
    for (const hash of [
      "",
      "#/alignment",
      `#/alignment/${job}`,
      `#/alignment/${key}`,
      `#/live/${job}/${key}`,
    ]) {
      expect(keyOfAddress(hash)).toBeNull();
    }
    expect(keyOfAddress(`#/alignment/${job}/${key}0`)).toBeNull();
    for (const text of ["", "confirm_", job]) expect(keyWithin(text)).toBeNull();
    expect(routeOf(`#/alignment/${job}/${key}`).jobs).toEqual([job]);
  });

  it("is told from a link that is not whole", () => {
    for (const hash of [`#/alignment/${job}/${key.slice(0, -5)}`, `#/alignment/${job.slice(1)}/${key}`])
      expect(isBrokenLink(hash)).toBe(true);
    for (const hash of ["", "#/alignment", `#/alignment/${job}`, `#/alignment/${job}/${key}`])
      expect(isBrokenLink(hash)).toBe(false);
  });

  it("is for its job, and for one at a time", () => {
    const keys = new ConfirmKeys(storage());
    expect(keys.of(job)).toBeNull();
    keys.keep({ job, key });
    expect(keys.of(job)).toBe(key);
    expect(keys.of("another")).toBeNull();
    keys.keep({ job: "another", key });
    expect(keys.of(job)).toBeNull();
    keys.forget();
    expect(keys.of("another")).toBeNull();
  });
});
