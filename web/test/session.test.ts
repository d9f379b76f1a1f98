import { expect, test } from "vitest";
import { keyOfLink, whyOut } from "../src/daemon/session";
import type { Ended, Session } from "../src/daemon/wire";

test("the key is taken from a one-time link and from nowhere else", () => {
  expect(keyOfLink({ pathname: "/login", search: "?once=abc" })).toBe("abc");
  expect(keyOfLink({ pathname: "/login", search: "" })).toBeNull();
  expect(keyOfLink({ pathname: "/", search: "?once=abc" })).toBeNull();
});

test("who is out is told why: the token has ended, or from now on one is demanded", () => {
  const local: Session = { name: "local", scope: "admin", signed_in: false, demanded: false };
  const ana: Session = { name: "Ana", scope: "control", signed_in: true, demanded: true };
  const ended: Ended = { how: "revoked", name: "Ana", at: "2026-01-01T00:00:00Z", by: "Ben" };
  expect(whyOut(ana, ended, null)).toBe(ended);
  expect(whyOut(null, ended, null)).toBe(ended);
  // Who signs out, or has never been in, is told nothing.
  expect(whyOut(ana, null, null)).toBeNull();
  expect(whyOut(null, null, null)).toBeNull();
  expect(whyOut(local, null, null)).toBe("demanded");
  // Asked again, it is for the same reason.
  expect(whyOut("stranger", null, "demanded")).toBe("demanded");
});
