// Which page is seen: it is in the address after the #, so that it can be linked to and gone back to.

/** So many runs are compared at most. */
export const COMPARED = 2;

/** What has a tab. */
export const PAGES = ["live", "alignment", "design", "history", "settings"] as const;
/** What is in the address, and the meter by itself, which no tab leads to. */
export type Page = (typeof PAGES)[number] | "meter";

export interface Route {
  page: Page;
  /** Ids of jobs: the one shown, or those compared. */
  jobs: string[];
}

/** The page that an address names; the live one where it names none. */
export function routeOf(hash: string): Route {
  const [name, ...rest] = hash.replace(/^#\/?/, "").split("/");
  const page = ([...PAGES, "meter"] as const).find((page) => page === name) ?? "live";
  const jobs = rest.filter((part) => /^[0-9a-f-]{36}$/.test(part));
  return { page, jobs: [...new Set(jobs)].slice(0, COMPARED) };
}

export function addressOf(page: Page, ...jobs: string[]): string {
  return `#/${[page, ...jobs].join("/")}`;
}
