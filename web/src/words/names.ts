// What people are called who have control, or had.

import { capitalised } from "./format";
import { strings } from "../strings";

/** What the daemon is told of whoever has given no name: in its own language, as it goes into records that all read. */
export const NAMELESS = "a browser";

let own = NAMELESS;

/** Says how this page is called where others are told who has control. */
export function callMe(name: string): void {
  own = name.trim() || NAMELESS;
}

/** How this page is called. */
export const me = () => own;

/** Where a name stands in a sentence. */
type Place = "first" | "within";

/** Written from right to left. */
const TURNED = /[\p{Script=Arabic}\p{Script=Hebrew}\p{Script=Syriac}\p{Script=Thaana}\p{Script=Nko}]/u;

/** How somebody is called on the page. A name written from right to left is set apart, so that it turns nothing around it;
 *  what stands for one that nobody has given has a capital where it comes first in a sentence. */
export function called(owner: string, place: Place = "within"): string {
  const { owner: nameless } = strings.lease;
  if (owner === NAMELESS) return place === "first" ? capitalised(nameless) : nameless;
  return TURNED.test(owner) ? `\u2068${owner}\u2069` : owner;
}

/** How somebody is called who is not at this page: the same person may be, in another window. */
export function another(owner: string, place: Place = "within"): string {
  const name = called(owner, place);
  return owner === own && owner !== NAMELESS ? strings.lease.elsewhere(name) : name;
}
