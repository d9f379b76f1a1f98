// The page's words in the language that it speaks, which is the only one that is loaded.

import { languageOf, localeOf, speaks, type Language, type LanguageChoice } from "./words/language";
import { recall } from "./preferences";
import type { strings as english } from "./strings/en";

export type Strings = typeof english;

const CATALOGUES: Record<Language, () => Promise<{ strings: Strings }>> = {
  en: () => import("./strings/en"),
  de: () => import("./strings/de"),
};

/** Read anew whenever something is said: they change with the language. */
export let strings: Strings;

/** Speaks the language chosen from now on; where its words cannot be had, nothing changes. */
export async function speak(choice: LanguageChoice): Promise<void> {
  const asked = navigator.languages;
  const language = languageOf(choice, asked);
  ({ strings } = await CATALOGUES[language]());
  speaks({ language, locale: localeOf(language, asked) });
}

await speak(recall(globalThis.localStorage).language);
