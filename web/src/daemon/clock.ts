// The daemon's clock, as it tells it: by it, what waited on its way is seen to have waited.
//
// Nothing comes before it was sent, and nothing is answered before it was asked: so what the daemon answers to a question
// says by how much this page's clock is ahead of the daemon's at least, however long the answer took. By that least, nothing
// is taken for younger than it is, also over a line that is late all the time.
//
// The daemon's clock here is that of its machine that nobody sets (CLOCK_MONOTONIC): its wall clock may be set at any time, by
// less than a line is late. How far that one is from it the daemon says with each sign of life.

import type { ServerMessage } from "./wire";

export interface Clock {
  /** The run of the daemon that it is of: another one may be of another machine, or that machine started anew. */
  bootId: string | null;
  /** This page's clock less the daemon's at least, ms, and at which of the daemon's answers that was known, this page's
   *  clock, ms; null before there was one. */
  least: { aheadMs: number; at: number } | null;
  /** The same at most, by the tick that waited least: what there is to go by until the daemon has answered. */
  mostMs: number | null;
  /** The same by the newest tick, which may have waited. */
  newestMs: number;
  /** The daemon's wall clock less the one that nobody sets, ms, as it said last. */
  wallMs: number | null;
}

export const unknown: Clock = {
  bootId: null,
  least: null,
  mostMs: null,
  newestMs: 0,
  wallMs: null,
};

/** Two clocks go apart by so much at most, ms a ms: what is set right is slewed no faster. */
const APART = 5e-4;
/** Clocks are read to a millisecond, ms; to two tenths of a second where the browser hides how late it is from whoever would
 *  know it again by that. */
const READ_MS = isFine(() => performance.now()) ? 2 : 250;

/** Whether a clock goes by steps of a few milliseconds. */
function isFine(now: () => number): boolean {
  /** Enough for a step of a millisecond to come. */
  const READINGS = 200_000;
  const FINE_MS = 5;
  let before = now();
  for (let k = 0; k < READINGS; k += 1) {
    const next = now();
    if (next > before && next - before <= FINE_MS) return true;
    before = next;
  }
  return false;
}

/** What the daemon says of its clocks. */
export interface Told {
  now: string;
  monotonic_us: number;
}

/** The clock with what a message says of it that came at `cameAt` of this page's clock, ms. */
export function clockAfter(clock: Clock, message: ServerMessage, cameAt: number): Clock {
  const of = clock.bootId === message.boot_id ? clock : { ...unknown, bootId: message.boot_id };
  if (message.type === "tick") return heard(of, cameAt, message);
  if (message.type === "clock") return answered(of, message.asked_ms, cameAt, message);
  return of;
}

/** The clock with another sign of life, which came at `cameAt` of this page's clock, ms. */
export function heard(clock: Clock, cameAt: number, { now, monotonic_us }: Told): Clock {
  const sentMs = monotonic_us / 1000;
  const [newestMs, wallMs] = [cameAt - sentMs, Date.parse(now) - sentMs];
  if (!Number.isFinite(newestMs) || !Number.isFinite(wallMs)) return clock;
  // It came before it was sent: one of the two clocks has stood, or runs wrong.
  if (newestMs < leastAt(clock, cameAt) - READ_MS)
    return { ...clock, least: null, mostMs: newestMs, newestMs, wallMs };
  return { ...clock, mostMs: Math.min(clock.mostMs ?? Infinity, newestMs), newestMs, wallMs };
}

/** The clock with what the daemon answered, asked at `askedAt`, which came at `cameAt`, ms. */
export function answered(clock: Clock, askedAt: number, cameAt: number, told: Told): Clock {
  const aheadMs = askedAt - told.monotonic_us / 1000;
  // What was not asked yet is no answer.
  if (!Number.isFinite(aheadMs) || cameAt < askedAt) return clock;
  const known = heard(clock, cameAt, told);
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

/** The same of the daemon's wall clock: what is told in hours and minutes is of it. */
export function aheadOfWall(clock: Clock): number | null {
  const aheadMs = ahead(clock);
  return aheadMs === null || clock.wallMs === null ? null : aheadMs - clock.wallMs;
}

/** A moment of the daemon's wall clock, ms, as it is set now, on the one that nobody sets; null where that is not known. */
export function monotonicOf({ wallMs }: Clock, at: number): number | null {
  return wallMs === null ? null : at - wallMs;
}

/** How long the newest tick waited on its way, ms: all that comes waits with it. */
export function lateness(clock: Clock): number {
  return Math.max(0, clock.newestMs - (ahead(clock) ?? clock.newestMs));
}

/** How long it is until a moment of the daemon's wall clock, RFC 3339, whole seconds; 0 once it has passed. */
export function secondsLeft(until: string, clock: Clock, now: number): number {
  return Math.max(0, Math.round((Date.parse(until) + (aheadOfWall(clock) ?? 0) - now) / 1000));
}

/** This page's clock when the daemon sent a picture that came at `cameAt`, ms. */
export function sentAt(
  clock: Clock,
  picture: { monotonicMs: number; ageMs: number },
  cameAt: number,
): number {
  const aheadMs = ahead(clock);
  if (aheadMs === null) return cameAt;
  return Math.min(cameAt, picture.monotonicMs + picture.ageMs + aheadMs);
}
