// What is looked for in the history.

import type { JobKind, JobState } from "../daemon/wire";

export interface Filter {
  text: string;
  kind: JobKind | "";
  state: JobState | "";
  /** Days as a date field has them, local; empty for no bound. */
  since: string;
  until: string;
}

export const everything: Filter = { text: "", kind: "", state: "", since: "", until: "" };
const PAGE = 20;
/** A year later than every run, whose last day has a day after it that the API knows. */
const LAST_YEAR = 9998;

/** A filter as the API takes it. */
export function queryOf(filter: Filter, cursor: string | null): URLSearchParams {
  const query = new URLSearchParams({ limit: String(PAGE) });
  if (filter.text.trim() !== "") query.set("q", filter.text.trim());
  if (filter.kind !== "") query.set("kind", filter.kind);
  if (filter.state !== "") query.set("state", filter.state);
  const since = midnight(filter.since, 0);
  if (since !== null) query.set("since", since);
  // The day named is meant with all its hours.
  const until = midnight(filter.until, 1);
  if (until !== null) query.set("until", until);
  if (cursor !== null) query.set("cursor", cursor);
  return query;
}

function midnight(day: string, later: number): string | null {
  const match = /^(\d{4,6})-(\d{2})-(\d{2})$/.exec(day);
  if (!match) return null;
  const date = new Date(0, 0);
  date.setFullYear(Number(match[1]), Number(match[2]) - 1, Number(match[3]) + later);
  // A year with a digit too many, which the API does not take, is later than every run as well.
  return date.getFullYear() > LAST_YEAR ? `${LAST_YEAR}-12-31T00:00:00Z` : date.toISOString();
}
