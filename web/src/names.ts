// What people are called who have control, or had.

import { strings } from "./strings";

/** What the daemon is told of whoever has given no name: in its own language, as it goes into records that all read. */
export const NAMELESS = "a browser";

/** How somebody is called on the page. */
export function called(owner: string): string {
  return owner === NAMELESS ? strings.lease.owner : owner;
}
