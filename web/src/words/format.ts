// Numbers as the page shows them: a fixed number of digits, a true minus sign, and a decimal point in every language.

import { spoken } from "./language";

export function fixed(value: number, digits: number): string {
  const text = value.toFixed(digits);
  return text.startsWith("-") ? (Number(text) === 0 ? text.slice(1) : `−${text.slice(1)}`) : text;
}

export function signed(value: number, digits: number): string {
  const text = fixed(value, digits);
  return text.startsWith("−") || Number(text) === 0 ? text : `+${text}`;
}

/** A value with its standard uncertainty, in one unit. */
export function withSigma(
  value: number | null | undefined,
  sigma: number | null | undefined,
  digits: number,
): string | null {
  if (value === null || value === undefined) return null;
  const text = fixed(value, digits);
  return sigma === null || sigma === undefined ? text : `${text} ± ${fixed(sigma, digits)}`;
}

/** With a capital. */
export function capitalised(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** Words that come after others' end as a sentence of their own: what they begin with stays as it is where it is a name. */
export function sentence(text: string): string {
  return /^(a|[a-z]{2,})[ ,]/.test(text) ? capitalised(text) : text;
}

/** A while in words, rounded: seconds, then minutes, then hours. */
export function span(ms: number): string {
  const seconds = ms / 1000;
  if (seconds < 99.5) return `${fixed(seconds, 0)} s`;
  return seconds < 99.5 * 60 ? `${fixed(seconds / 60, 0)} min` : `${fixed(seconds / 3600, 0)} h`;
}

/** How old something is that is replaced several times a second: in milliseconds while that goes on. */
export function age(ms: number): string {
  return ms < 1999.5 ? `${fixed(ms, 0)} ms` : span(ms);
}

/** How long there is to wait, in words, rounded up. */
export function wait(seconds: number): string {
  return seconds < 90 ? `${Math.ceil(seconds)} s` : `${Math.ceil(seconds / 60)} min`;
}

/** The time of day of a moment, RFC 3339. */
export function clock(at: string): string {
  return new Date(at).toLocaleTimeString(spoken.locale);
}

/** Day and time of a moment, RFC 3339; the month in letters, or after the day with points, so that nobody takes it for that. */
export function moment(at: string): string {
  return new Date(at).toLocaleString(spoken.locale, { dateStyle: "medium", timeStyle: "medium" });
}

/** The same to the minute: of what is known no better. */
export function aboutWhen(at: string): string {
  return new Date(at).toLocaleString(spoken.locale, { dateStyle: "medium", timeStyle: "short" });
}
