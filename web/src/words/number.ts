// Numbers as people type them.

import { spoken } from "./language";

/** A thousand and more to one reader, and one and a fraction to another. */
const AMBIGUOUS = /^[+-]?[1-9]\d{0,2},\d{3}$/;

/** What a script takes for a number besides, such as 0x10, nobody types for one. */
const DECIMAL = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;

/** A number as people type it: with a point, as the page shows it, or with a comma; NaN for what is none, and for what is read
 *  in two ways by those who read the page's language. */
export function numberOf(text: string): number {
  const plain = text.trim().replace("−", "-");
  if (plain === "" || (spoken.language === "en" && AMBIGUOUS.test(plain))) return NaN;
  const read = plain.replace(",", ".");
  return DECIMAL.test(read) ? Number(read) : NaN;
}
