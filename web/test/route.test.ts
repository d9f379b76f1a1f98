import { describe, expect, it } from "vitest";
import { addressOf, routeOf } from "../src/browser/route";

const JOBS = [1, 2, 3].map((one) => `00000000-0000-7000-8000-00000000000${one}`);

describe("the address", () => {
  it("names a page, and the runs that are compared: two at most, none twice", () => {
    expect(routeOf(addressOf("history", ...JOBS.slice(0, 2)))).toEqual({
      page: "history",
      jobs: JOBS.slice(0, 2),
    });
    expect(routeOf(addressOf("history", ...JOBS)).jobs).toEqual(JOBS.slice(0, 2));
    expect(routeOf(addressOf("history", JOBS[0]!, JOBS[0]!)).jobs).toEqual([JOBS[0]]);
    expect(routeOf("#/nowhere/x")).toEqual({ page: "live", jobs: [] });
  });
});
