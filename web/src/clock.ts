// The daemon's clock, as its ticks tell it: by it, what waited in a queue on its way is seen to have waited.

/** This page's clock less the daemon's, ms, by each of the newest ticks. */
export type Clock = readonly number[];

/** So few that a clock that is set is soon followed: ticks come every second. */
const KEPT = 20;

export const unknown: Clock = [];

/** The clock with another tick, which came at `cameAt` of this page's clock, ms. */
export function heard(clock: Clock, cameAt: number, now: string): Clock {
  const aheadMs = cameAt - Date.parse(now);
  return Number.isFinite(aheadMs) ? [...clock.slice(1 - KEPT), aheadMs] : clock;
}

/** This page's clock less the daemon's, ms, by the tick that waited least; null before there was one. */
export function ahead(clock: Clock): number | null {
  return clock.length > 0 ? Math.min(...clock) : null;
}

/** How much longer than the one that waited least the newest tick waited, ms: all that comes waits with it. */
export function lateness(clock: Clock): number {
  return (clock.at(-1) ?? 0) - (ahead(clock) ?? 0);
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
