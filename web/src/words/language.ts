// The language that the page speaks, and how dates are written in it.

export const LANGUAGES = ["en", "de"] as const;
export type Language = (typeof LANGUAGES)[number];

/** What can be chosen: the browser's own, or one of the page's. */
export const LANGUAGE_CHOICES = ["browser", ...LANGUAGES] as const;
export type LanguageChoice = (typeof LANGUAGE_CHOICES)[number];

/** How dates are written where the browser has no wish of its own: in no language with the month before the day. */
const LOCALES: Record<Language, string> = { en: "en-GB", de: "de-DE" };

function isOf(language: Language, tag: string): boolean {
  return tag.toLowerCase().split("-")[0] === language;
}

/** The language chosen; the browser's is the first of those it asks for that the page has, and else English. */
export function languageOf(choice: LanguageChoice, asked: readonly string[]): Language {
  if (choice !== "browser") return choice;
  const has = (tag: string) => LANGUAGES.find((language) => isOf(language, tag));
  return asked.map(has).find((language) => language !== undefined) ?? "en";
}

/** The language's locale: that of the browser's own region, where it asks for one of this language. */
export function localeOf(language: Language, asked: readonly string[]): string {
  return asked.find((tag) => isOf(language, tag)) ?? LOCALES[language];
}

export interface Spoken {
  language: Language;
  locale: string;
}

/** What is spoken now. Only what loads the words changes it. */
export let spoken: Spoken = { language: "en", locale: LOCALES.en };

export function speaks(now: Spoken): void {
  spoken = now;
}
