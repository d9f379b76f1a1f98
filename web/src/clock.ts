// The daemon's clock, as it tells it: by it, what waited on its way is seen to have waited.
//
// Nothing comes before it was sent, and nothing is answered before it was asked: so what the daemon answers to a question
// says by how much this page's clock is ahead of the daemon's at least, however long the answer took. By that least, nothing
// is taken for younger than it is, also over a line that is late all the time.

import type { ServerMessage } from "./wire";

export interface Clock {
  /** This page's clock less the daemon's at least, ms, and at which of the daemon's answers that was known, this page's
   *  clock, ms; null before there was one. */
  least: { aheadMs: number; at: number } | null;
  /** The same at most, by the tick that waited least: what there is to go by until the daemon has answered. */
  mostMs: number | null;
  /** The same by the newest tick, which may have waited. */
  newestMs: number;
}

export const unknown: Clock = { least: null, mostMs: null, newestMs: 0 };

/** Two clocks go apart by so much at most, ms a ms: what is set right is slewed no faster. */
const APART = 5e-4;
/** Clocks are read to a millisecond, ms. */
const READ_MS = 2;

/** The clock with what a message says of it, which came at `cameAt` of this page's clock, ms. */
export function clockAfter(clock: Clock, message: ServerMessage, cameAt: number): Clock {
  if (message.type === "tick") return heard(clock, cameAt, message.now);
  return message.type === "clock" ? answered(clock, message.asked_ms, cameAt, message.now) : clock;
}

/** The clock with another tick, which came at `cameAt` of this page's clock, ms. */
export function heard(clock: Clock, cameAt: number, now: string): Clock {
  const newestMs = cameAt - Date.parse(now);
  if (!Number.isFinite(newestMs)) return clock;
  // It came before it was sent: one of the clocks has been set.
  if (newestMs < leastAt(clock, cameAt) - READ_MS) return { least: null, mostMs: newestMs, newestMs };
  return { ...clock, mostMs: Math.min(clock.mostMs ?? Infinity, newestMs), newestMs };
}

/** The clock with what the daemon answered, asked at `askedAt`, which came at `cameAt`, ms. */
export function answered(clock: Clock, askedAt: number, cameAt: number, now: string): Clock {
  const aheadMs = askedAt - Date.parse(now);
  // This page's clock was set back meanwhile.
  if (!Number.isFinite(aheadMs) || cameAt < askedAt) return clock;
  const known = heard(clock, cameAt, now);
  return { ...known, least: { aheadMs: Math.max(leastAt(known, cameAt), aheadMs), at: cameAt } };
}

function leastAt({ least }: Clock, at: number): number {
  return least ? least.aheadMs - APART * Math.max(0, at - least.at) : -Infinity;
}

/** This page's clock less the daemon's, ms: so that nothing is younger by it than it is, once the daemon has answered; null
 *  before it has said anything. */
export function ahead({ least, mostMs }: Clock): number | null {
  return least?.aheadMs ?? mostMs;
}

/** How long the newest tick waited on its way, ms: all that comes waits with it. */
export function lateness(clock: Clock): number {
  return Math.max(0, clock.newestMs - (ahead(clock) ?? clock.newestMs));
}

/** How long it is until a moment of the daemon's clock, RFC 3339, whole seconds; 0 once it has passed. */
export function secondsLeft(until: string, clock: Clock, now: number): number {
  return Math.max(0, Math.round((Date.parse(until) + (ahead(clock) ?? 0) - now) / 1000));
}

/** This page's clock when the daemon sent a picture that came at `cameAt`, ms. */
export function sentAt(clock: Clock, picture: { capturedAt: Date; ageMs: number }, cameAt: number): number {
  const aheadMs = ahead(clock);
  if (aheadMs === null) return cameAt;
  return Math.min(cameAt, picture.capturedAt.getTime() + picture.ageMs + aheadMs);
}
