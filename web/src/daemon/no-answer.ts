// That the daemon did not answer, as a problem of this page's own: over once it does.

import { strings } from "../strings";
import type { Problem } from "./wire";

/** Its type, which no answer has. */
export const NO_ANSWER = "urn:plenalign:page:no-answer";

/** What a request that failed by itself comes to. */
export function noAnswer(error: unknown): Problem {
  // What a browser says of its clock and of its connection is in a language of its own.
  const late = error instanceof DOMException && error.name === "TimeoutError";
  const own = late ? strings.noAnswerInTime : error instanceof TypeError ? strings.noConnection : null;
  const detail = own ?? (error instanceof Error ? error.message : String(error));
  return { type: NO_ANSWER, title: strings.noAnswer, status: 0, detail };
}
