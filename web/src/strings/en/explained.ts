// What the words of the field mean: in English the documentation's glossary says it.

import type { Word } from "../../words/glossary";

/** The full term of a word that is explained where it stands, and its meaning; null where the glossary's words stand. */
export const explained = (_word: Word): { term: string; meaning: string } | null => null;
