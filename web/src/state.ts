// The page's one state, and what follows from it. Pure: views draw from it, tests feed it.

import { ahead, aheadOfWall, unknown, type Clock } from "./daemon/clock";
import { type Best, type Missing, type Reading } from "./meter/reading";
import type { JsonObject } from "./design/config-schema";
import type { ConfigFile } from "./design/draft";
import type { Draft } from "./job/kinds";
import type { ControlLost } from "./daemon/lease";
import { routeOf, type Route } from "./browser/route";
import { standard, type Preferences } from "./preferences";
import {} from "./bench/travel";
import { noTrail, type AxesPoint, type ClarityPoint, type SpacingPoint, type Trail } from "./charts/trail";
import {} from "./daemon/no-answer";
import {} from "./daemon/over";
import type {
  Bench,
  Design,
  Draft as CameraDraft,
  Ended,
  Job,
  JobState,
  Measurement,
  NewToken,
  PictureFacts,
  Problem,
  Scope,
  Session,
  StopReport,
  StopReset,
} from "./daemon/wire";

export type Link = "connecting" | "open" | "lost";

export interface State {
  /** Who one is to the daemon; "stranger" where it asks for a token; null before it has said. */
  session: Session | "stranger" | null;
  /** Why a stranger is out who was in; null where that is not so. */
  out: Ended | "demanded" | null;
  link: Link;
  /** When a lost connection is tried again, this page's clock, ms; null while it is being tried. */
  retryAt: number | null;
  bootId: string | null;
  seq: number;
  version: string | null;
  bench: Bench | null;
  /** Newest last. */
  jobs: Job[];
  /** The newest in whole. */
  measurement: Measurement | null;
  clock: Clock;
  /** What the meter shows: the newest spacing. */
  reading: Reading | null;
  /** This page's clock when the reading was sent, ms, as far as is known without the daemon's clock. */
  readingAt: number | null;
  /** Why there is none of a newer frame. */
  missing: Missing | null;
  missingAt: number | null;
  /** Frames that were not read. */
  framesLeftOut: number;
  /** Columns of the raw frame read last; 0 before there was one. */
  widthPx: number;
  picture: PictureFacts | null;
  /** This page's clock when the picture was sent, ms. */
  pictureAt: number | null;
  /** Older than this, it does not show how things are, ms. */
  pictureOldMs: number;
  /** This page's clock when anything came, ms. */
  heardAt: number | null;
  /** The newest thing that went wrong, for the operator to read and dismiss. */
  problem: Problem | null;
  /** Since when it is over by itself, this page's clock, ms; null while it is not. */
  overAt: number | null;
  /** A stop that could not be delivered: nothing else hides it. */
  stopFailed: Problem | null;
  /** That such a stop has not arrived, until that is dismissed: whatever else goes well or wrong does not hide it. */
  notStopped: boolean;
  /** Whether a tone follows the spacing. */
  tone: boolean;
  /** A token just made, whose secret nobody has said yet to have kept. */
  made: NewToken | null;
  /** Who has taken control of the bench from this page, until that is dismissed. */
  controlLost: ControlLost | null;
  /** The job that somebody puts together on this page; null while nobody has begun to. */
  drafted: Draft | null;
  /** The camera that somebody drafts on this page, and the configuration over which; null while nobody has begun to. */
  draftedCamera: { draft: JsonObject; over: JsonObject } | null;
  /** What cameras come to, as the daemon said last: those in force and of the paper, and what is edited as far as it could be. */
  cameras: { inForce: CameraDraft | null; preset: CameraDraft | null; shown: CameraDraft | null };
  /** The file that the camera is saved into, as far as this page knows it. */
  configFile: ConfigFile | null;
  /** When the newest reset was that has been read and dismissed. */
  resetSeen: string | null;
  /** What became of a stop that this page sent, axis by axis, until it is reset. */
  stopSent: Pick<StopReport, "focus" | "e" | "kept"> | null;
  route: Route;
  preferences: Preferences;
  /** The design of the configured camera, where it has been asked for. */
  design: Design | null;
  /** The reading closest to its target since this was reset. */
  best: Best | null;
  spacings: Trail<SpacingPoint>;
  clarities: Trail<ClarityPoint>;
  axes: Trail<AxesPoint>;
}

/** Older than this, a raw frame does not show how things are, ms. */
export const STALE_MS = 2000;

export const initial: State = {
  session: null,
  out: null,
  link: "connecting",
  retryAt: null,
  bootId: null,
  seq: 0,
  version: null,
  bench: null,
  jobs: [],
  clock: unknown,
  measurement: null,
  reading: null,
  readingAt: null,
  missing: null,
  missingAt: null,
  framesLeftOut: 0,
  widthPx: 0,
  picture: null,
  pictureAt: null,
  pictureOldMs: STALE_MS,
  heardAt: null,
  problem: null,
  overAt: null,
  stopFailed: null,
  notStopped: false,
  tone: false,
  made: null,
  controlLost: null,
  drafted: null,
  draftedCamera: null,
  cameras: { inForce: null, preset: null, shown: null },
  configFile: null,
  resetSeen: null,
  stopSent: null,
  route: routeOf(""),
  preferences: standard,
  design: null,
  best: null,
  spacings: noTrail,
  clarities: noTrail,
  axes: noTrail,
};

/** Older than this, a measurement says how old it is: a frame takes a second or two to be taken and measured, ms. */
const OLD_MEASUREMENT_MS = 5000;
/** A frame is read several times a second: older than this, its reading says how old it is, ms. */
const OLD_READING_MS = 1000;
/** Where the spacing is lost, a search takes longer, and nothing is said meanwhile, ms. */
const OLD_SEARCH_MS = 5000;

/** Whether what is held down is let go of by this: by a stop, also one that has been reset already, or a lost connection. */
export function endsPress(before: State, after: State): boolean {
  const stop = after.bench?.stop;
  return after.link !== "open" || stop?.latched === true || stop?.reset?.at !== before.bench?.stop.reset?.at;
}

/** How long a reset is news, ms. */
const NEWS_MS = 600_000;

/** The reset of the stop that is still news, where nobody has dismissed it here. */
export function newsOfReset(state: State, now: number): StopReset | null {
  const stop = state.bench?.stop;
  if (!stop?.reset || stop.latched || stop.reset.at === state.resetSeen) return null;
  return now - (aheadOfWall(state.clock) ?? 0) - Date.parse(stop.reset.at) < NEWS_MS ? stop.reset : null;
}

/** Age of the picture shown, ms. */
export function pictureAge(state: State, now: number): number | null {
  return state.picture && state.pictureAt !== null ? state.picture.ageMs + (now - state.pictureAt) : null;
}

/** What was said last of the spacing, and how long that holds, ms. */
interface Word {
  of: "frame" | "measurement";
  capturedAt: number;
  monotonicMs: number | null;
  sentAt: number;
  oldMs: number;
}

export function wordOf({ missing, missingAt, reading, readingAt }: State): Word | null {
  if (missing && missingAt !== null) {
    const oldMs = missing.is === "lost" ? OLD_SEARCH_MS : OLD_READING_MS;
    const { capturedAt, monotonicMs } = missing;
    return { of: "frame", capturedAt, monotonicMs, sentAt: missingAt, oldMs };
  }
  if (!reading || readingAt === null) return null;
  const oldMs = reading.of === "frame" ? OLD_READING_MS : OLD_MEASUREMENT_MS;
  const { of, capturedAt, monotonicMs } = reading;
  return { of, capturedAt, monotonicMs, sentAt: readingAt, oldMs };
}

/** When a frame was taken, this page's clock, ms: where the daemon's is not known, what is given in its place. The one clock of
 *  meter and charts. */
export function pageTime(
  state: State,
  of: Pick<Reading, "capturedAt" | "monotonicMs">,
  otherwise: number,
): number {
  const aheadMs = ahead(state.clock);
  if (of.monotonicMs === null) return wallTime(state, of.capturedAt, otherwise);
  return aheadMs === null ? otherwise : of.monotonicMs + aheadMs;
}

/** The same by the daemon's wall clock, where nothing else is said of when. */
export function wallTime(state: State, capturedAt: number, otherwise: number): number {
  const aheadMs = aheadOfWall(state.clock);
  return aheadMs === null ? otherwise : capturedAt + aheadMs;
}

/** Since its frame was taken where the daemon's clock is known, or since it was sent, ms. */
export function wordAge(state: State, word: Word, now: number): number {
  return Math.max(0, now - pageTime(state, word, word.sentAt));
}

/** Age of what the meter shows, ms. */
export function meterAge(state: State, now: number): number | null {
  const refused = state.missing?.is === "refused";
  const shown = wordOf(refused ? { ...state, missing: null } : state);
  return shown && wordAge(state, shown, now);
}

/** Whether what the meter shows may no longer be so: it has passed, or nothing newer is known. */
export function isMeterOld(state: State, now: number): boolean {
  const word = wordOf(state);
  if (!word) return false;
  const ended =
    state.missing?.is === "refused" || state.link !== "open" || state.bench?.camera.online === false;
  return ended || wordAge(state, word, now) > word.oldMs;
}

export type PictureState = "none" | "fresh" | "stale";

export function pictureState(state: State, now: number): PictureState {
  const age = pictureAge(state, now);
  if (age === null) return "none";
  return state.link === "open" && age <= state.pictureOldMs ? "fresh" : "stale";
}

/** So many pictures in a row that are the same are no chance. */
const SAME = 3;

/** Whether the camera gives the same picture again and again, as far as is seen. */
export function isFrozen(state: State, now: number): boolean {
  return pictureState(state, now) === "fresh" && state.picture !== null && state.picture.alike >= SAME;
}

const FINAL: JobState[] = ["converged", "succeeded", "not_converged", "cancelled", "failed", "interrupted"];

export function isFinal(state: JobState): boolean {
  return FINAL.includes(state);
}

/** The job under way, or else the newest. */
export function currentJob(state: Pick<State, "bench" | "jobs">): Job | null {
  const held = state.jobs.find((job) => job.id === state.bench?.job);
  return held ?? state.jobs[state.jobs.length - 1] ?? null;
}

/** The job under way. */
export function jobUnderWay(state: Pick<State, "bench" | "jobs">): Job | null {
  const job = currentJob(state);
  return job && !isFinal(job.state) ? job : null;
}

/** What names the prompt that the job under way waits with; null while it waits for nobody. */
export function turnOf(state: State): string | null {
  const job = jobUnderWay(state);
  const step = job?.state === "waiting_for_operator" ? job.operator_step : null;
  return job && step ? `${job.id} ${step.number}` : null;
}

const SCOPES: Scope[] = ["view", "control", "admin"];

/** Whether whoever uses the page may do what needs `scope`. */
export function may(state: State, scope: Scope): boolean {
  if (state.session === null || state.session === "stranger") return false;
  return SCOPES.indexOf(state.session.scope) >= SCOPES.indexOf(scope);
}

/** Whether a command that needs `scope` is offered now: it is allowed, and the daemon is there to be told. */
export function able(state: State, scope: Scope): boolean {
  return state.link === "open" && may(state, scope);
}
