// Who one is to the daemon: asked, signed in, signed out. The session itself is a cookie that no script sees.

import { noAnswer } from "./no-answer";
import type { Ended, Problem, Session } from "./wire";

const PATH = "/api/v1/session";
/** Where the one-time link leads. */
const LINK = "/login";
const TIMEOUT_MS = 8000;

/** Somebody known; a stranger, of whom a token is demanded, and why a token that let them in does so no more; or no answer
 *  that says. */
export type Who =
  { is: "known"; session: Session } | { is: "stranger"; ended: Ended | null } | { is: "unclear" };

export async function whoAmI(): Promise<Who> {
  try {
    const response = await fetch(PATH, { signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (response.status === 401) return { is: "stranger", ended: await endedIn(response) };
    if (response.ok) return { is: "known", session: (await response.json()) as Session };
  } catch {
    // The connection's own state is shown elsewhere.
  }
  return { is: "unclear" };
}

async function endedIn(response: Response): Promise<Ended | null> {
  try {
    return ((await response.json()) as { ended?: Ended }).ended ?? null;
  } catch {
    return null;
  }
}

/** Why somebody is out who was in: their token has ended, or from now on one is demanded; null where nothing says so. A
 *  stranger stays out for the reason that was `said`. */
export function whyOut(
  before: Session | "stranger" | null,
  ended: Ended | null,
  said: Ended | "demanded" | null,
): Ended | "demanded" | null {
  if (ended !== null || before === null) return ended;
  if (before === "stranger") return said;
  return before.demanded ? null : "demanded";
}

/** Signs in with a token or the one-time key; the problem, if there is one. */
export async function signIn(key: string): Promise<Problem | null> {
  try {
    const response = await fetch(PATH, {
      method: "POST",
      headers: { "content-type": "application/json" },
      body: JSON.stringify({ key }),
      signal: AbortSignal.timeout(TIMEOUT_MS),
    });
    return response.ok ? null : ((await response.json()) as Problem);
  } catch (error) {
    return noAnswer(error);
  }
}

export async function signOut(): Promise<void> {
  await fetch(PATH, { method: "DELETE", signal: AbortSignal.timeout(TIMEOUT_MS) }).catch(() => undefined);
}

/** The key of a one-time link, where this page was opened by one. */
export function keyOfLink(location: Pick<Location, "pathname" | "search">): string | null {
  if (location.pathname !== LINK) return null;
  return new URLSearchParams(location.search).get("once");
}
