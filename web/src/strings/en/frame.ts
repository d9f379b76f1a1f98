// Words of the page's frame: banners, connection, stop, sign-in.

import type { Page } from "../../browser/route";
import type { Scope } from "../../daemon/wire";

export const frame = {
  title: "Plenalign",
  windowTitle: (
    page: string,
    simulated: boolean,
    replayed: boolean,
    first: "yours" | "operators" | "lost" | null,
  ) => {
    const says = {
      yours: "● Your turn · ",
      operators: "● The operator’s turn · ",
      lost: "CONNECTION LOST · ",
    };
    return `${first ? says[first] : ""}${simulated ? "SIMULATED · " : ""}${replayed ? "REPLAY · " : ""}${page} · Plenalign`;
  },
  simulated: "SIMULATED BENCH",
  simulatedMore: "No hardware is attached: every picture and figure here is computed.",
  simulatedAxes: "No axis is attached: where they stand is computed.",
  replay: "REPLAY",
  replayMore: "Recorded frames are played from files: nothing that is seen is happening now.",
  connecting: "Connecting…",
  lost: "CONNECTION LOST",
  lostMore: "What is shown below is old. STOP may not get through: use the switch on the bench.",
  old: (span: string) => `OLD · ${span}`,
  retryIn: (span: string) => `Trying again in ${span}`,
  retrying: "Trying again…",
  retryNow: "Try now",
  cameraGone: "The camera is gone",
  cameraGoneMore: "It sends nothing.",
  cameraFrozen: "The camera gives an old picture again",
  cameraFrozenMore: "What is seen is not of now: unplug the camera and plug it in again.",
  stageGone: (axes: string[]) => `Not connected: ${axes.join(", ").toLowerCase()}`,
  stageGoneMore: "Nothing can be moved.",
  noAnswer: "The daemon does not answer",
  noAnswerInTime: "no answer came in time",
  noConnection: "there is no connection to it",
  dismiss: "Dismiss",
  close: "Close",
  historyFault: "Nothing can be moved",
  viewOnly: "You may look and stop; to command the bench, sign in with a token that may command.",
  skip: "Skip to the content",
  pagesLabel: "Pages",
  pages: {
    live: "Live",
    alignment: "Alignment",
    design: "Design",
    history: "History",
    settings: "Settings",
    meter: "Focus",
  } satisfies Record<Page, string>,
};

export const stop = {
  stop: "STOP",
  more: (key: string) => `Stop every axis at once (${key}, unless you type text)`,
  key: (key: string) => `or ${key}`,
  space: "Space",
  stopped: "Stopped",
  stoppedSince: (time: string, by: string) => `Stopped at ${time}${by && ` by ${by}`}`,
  unread: (why: string) => `How an earlier run left the stop is not known: ${why}.`,
  notKept: "It is not on the disk yet: after a restart the bench would not be stopped.",
  stoppedMore: "Motion is refused until the stop is reset.",
  sent: (focus: string, e: string) => `Focus axis: ${focus}; e axis: ${e}.`,
  reset: "Reset stop",
  resetAsk: "Reset stop…",
  why: "Why may it move again?",
  whyMore: "what was seen to; everybody is shown it",
  stay: "Stay stopped",
  wasReset: (by: string, time: string) => `${by} reset the stop at ${time}`,
  hadStopped: (by: string, time: string) => `stopped at ${time}${by && ` by ${by}`}`,
  failed: "STOP WAS NOT DELIVERED",
  failedMore: "Use the hardware emergency stop.",
  notStopped: "The bench is not stopped",
  notStoppedMore: "The connection is back, and the STOP that you gave meanwhile has not arrived.",
  tried: "The page goes on trying.",
  again: "Stop again",
  delivery: { confirmed: "stopped", sent: "sent, not confirmed", undeliverable: "NOT DELIVERABLE" },
};

export const signIn = {
  signIn: "Sign in",
  more: "This daemon asks for a token: anyone who administers it makes one with “plenalign token create”. What is under way at the bench goes on meanwhile, and STOP is out of reach here: the hardware emergency stop is not.",
  signOut: "Sign out",
  token: "Token",
  handed: "The link that you have opened lets you confirm a job’s steps. Sign in, and they are before you.",
  /** Why one is out who was in. */
  ended: {
    revoked: (name: string, when: string, by: string | null) =>
      `The token of ${name} was revoked ${by === null ? "on the daemon’s machine" : `by ${by}`}, ${when}: it lets nobody in any more.`,
    expired: (name: string, when: string) => `The token of ${name} has expired, ${when}.`,
    demanded: "From now on everybody is asked for a token.",
  },
  scope: {
    view: "may look and stop",
    control: "may command",
    admin: "may do everything",
  } satisfies Record<Scope, string>,
};
