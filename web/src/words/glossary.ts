// What the words of the field mean: in English the documentation's glossary, and no second wording.

import text from "../../../docs/glossary.md?raw";

export interface Entry {
  term: string;
  symbol: string;
  /** Its name in the configuration, the reports and the API; empty where it has none. */
  name: string;
  meaning: string;
}

/** The rows of its tables that have a symbol's column. */
export function entriesOf(markdown: string): Entry[] {
  return markdown
    .split("\n")
    .filter((line) => line.startsWith("|") && !/^\|[-| ]+\|$/.test(line))
    .map((line) => line.slice(1, -1).split("|").map(plain))
    .flatMap(([term, symbol, name, meaning, ...more]) =>
      term &&
      meaning &&
      symbol !== undefined &&
      name !== undefined &&
      more.length === 0 &&
      symbol !== "symbol"
        ? [{ term, symbol, name, meaning }]
        : [],
    );
}

/** Without what Markdown marks code by. */
function plain(cell: string): string {
  return cell.replaceAll("`", "").trim();
}

/** What is explained where it stands, by its symbol, which is the same in every language. */
export const EXPLAINED = ["Δv", "e", "EOG", "MLA", "l_bound"] as const;
export type Word = (typeof EXPLAINED)[number];

const entries = entriesOf(text);

/** What a word means; null where the glossary does not have it. */
export function explain(word: string): Entry | null {
  return entries.find(({ symbol }) => symbol === word) ?? null;
}

/** By themselves: not within a word, and not as what another symbol is of. */
const APART = new RegExp(`(?<![\\p{L}\\d_’'-])(${EXPLAINED.join("|")})(?![\\p{L}\\d_’'-])`, "u");

/** A text in pieces: what is explained, each word once, and what is between. */
export function pieces(text: string): (string | { word: Word })[] {
  const told = new Set<string>();
  return text.split(APART).flatMap((piece, index): (string | { word: Word })[] => {
    if (index % 2 === 0) return piece === "" ? [] : [piece];
    if (told.has(piece)) return [piece];
    told.add(piece);
    return [{ word: piece as Word }];
  });
}
