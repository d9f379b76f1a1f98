// What every view is given.

import type { Result } from "../daemon/api";
import type { State } from "../state";
import type { TokenRequest } from "../daemon/wire";

/** Carries a request out and shows its problem if it has one; whether it went well. */
export type Act = (request: Promise<Result<unknown>>) => Promise<boolean>;

export interface Given {
  state: State;
  /** The state as it is by now: readings have come since all of the page was drawn. */
  newest: () => State;
  /** This page's clock, ms. */
  now: number;
  update: (change: Partial<State>) => void;
  act: Act;
  /** The same for what the page asks by itself: that it went well takes no problem out of sight, and that it did not hides none. */
  load: Act;
  /** Makes a token, and signs in with it where it is the first; whether it was made. */
  makeToken: (token: TokenRequest) => Promise<boolean>;
}
