import { expect, test } from "vitest";
import { keyOfLink } from "../src/session";

test("the key is taken from a one-time link and from nowhere else", () => {
  expect(keyOfLink({ pathname: "/login", search: "?once=abc" })).toBe("abc");
  expect(keyOfLink({ pathname: "/login", search: "" })).toBeNull();
  expect(keyOfLink({ pathname: "/", search: "?once=abc" })).toBeNull();
});
