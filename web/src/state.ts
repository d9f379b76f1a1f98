// The page's one state, and how messages change it. Pure: views draw from it, tests feed it.

import { ahead, aheadOfWall, clockAfter, monotonicOf, unknown, type Clock } from "./daemon/clock";
import {
  bestWith,
  frameReading,
  missing,
  reading,
  type Best,
  type Missing,
  type Reading,
} from "./meter/reading";
import type { JsonObject } from "./design/config-schema";
import type { ConfigFile } from "./design/draft";
import type { Draft } from "./job/kinds";
import type { ControlLost } from "./daemon/lease";
import { routeOf, type Route } from "./browser/route";
import { sceneOf, setUpAt, type Scene } from "./meter/set-up";
import { standard, type Preferences } from "./preferences";
import { placeOf } from "./bench/travel";
import {
  axesWeight,
  clarityWeight,
  filled,
  follow,
  noTrail,
  spacingWeight,
  type AxesPoint,
  type ClarityPoint,
  type SpacingPoint,
  type Trail,
} from "./charts/trail";
import { NO_ANSWER } from "./daemon/no-answer";
import { isOver } from "./daemon/over";
import type {
  Bench,
  Design,
  Draft as CameraDraft,
  Ended,
  FrameReading,
  Job,
  JobState,
  Measurement,
  NewToken,
  PictureFacts,
  Problem,
  Recent,
  Scope,
  ServerMessage,
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
/** What is made of a frame takes its time: it is old once the next one is late by this many times as long as that takes, and
 *  at this age however long it takes, ms. */
const LATE = 1.5;
/** Two pictures of a kind follow one another within so many times the age of one, at most. */
const MOST_AGES = 10;
const OLDEST_MS = 30_000;

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

/** So long what went wrong stands when it is over, to be read, ms. */
const READ_MS = 5000;

/** The state after a message that came at `now` of this page's clock. What was read of another set-up is gone with it, and
 *  so is a problem that is over. */
export function receive(state: State, message: ServerMessage, now: number): State {
  const next = withoutOver(received(state, message, now), now);
  const at = setUpAt(next.bench);
  const anew = at !== setUpAt(state.bench);
  if (!anew && message.type !== "snapshot") return next;
  const ofThis = <Word extends { capturedAt: number }>(word: Word | null) =>
    word && word.capturedAt >= at ? word : null;
  const best = anew ? null : next.best;
  return { ...next, reading: ofThis(next.reading), missing: ofThis(next.missing), best };
}

function withoutOver(state: State, now: number): State {
  const { problem, bench } = state;
  if (!problem || !bench || !isOver(problem, bench)) return { ...state, overAt: null };
  const overAt = state.overAt ?? now;
  return now - overAt < READ_MS ? { ...state, overAt } : { ...state, problem: null, overAt: null };
}

function received(state: State, message: ServerMessage, now: number): State {
  const heardOf = { ...state, heardAt: now, link: "open" as const };
  // Another start of the daemon: nothing of the old one holds.
  if (state.bootId !== null && message.boot_id !== state.bootId && message.type !== "snapshot")
    return heardOf;
  const heard = { ...heardOf, clock: clockAfter(state.clock, message, now) };
  const seq = Math.max(message.seq, message.type === "snapshot" ? 0 : state.seq);
  switch (message.type) {
    case "snapshot":
      return {
        ...heard,
        seq,
        bootId: message.boot_id,
        version: message.version,
        bench: message.bench,
        // What another run's axes made of it is not known of this one's.
        stopSent: [null, message.boot_id].includes(state.bootId) ? withStop(state, message.bench) : null,
        ...withOutage(state, message.bench, true),
        jobs: message.jobs,
        ...withSnapshot(message.measurement ?? null, sceneOf(message.bench), heard.clock, now),
        axes: withAxes(state, message.bench, now),
        // The daemon answers again: that it did not is over.
        problem: state.problem?.type === NO_ANSWER ? null : state.problem,
        ...(message.boot_id === state.bootId ? {} : { picture: null, pictureAt: null, best: null }),
      };
    case "bench":
      return {
        ...heard,
        seq,
        bench: message.bench,
        stopSent: withStop(state, message.bench),
        ...withOutage(state, message.bench, Boolean(state.bench?.stop.unread)),
        axes: withAxes(state, message.bench, now),
      };
    case "job":
      return { ...heard, seq, jobs: withJob(state.jobs, message.job) };
    case "measurement":
      return {
        ...heard,
        seq,
        measurement: message.measurement,
        clarities: follow(
          state.clarities,
          wallTime(state, Date.parse(message.measurement.captured_at), now) / 1000,
          message.measurement.eog ?? null,
          clarityWeight,
        ),
        ...withMeasurement(state, message.measurement, now),
      };
    case "tick":
    case "clock":
    case "gap":
      return { ...heard, seq };
    case "problem":
      return { ...heard, seq, problem: message.problem };
  }
}

function withSnapshot(
  measurement: Measurement | null,
  scene: Scene,
  clock: Clock,
  now: number,
): Partial<State> {
  return {
    measurement,
    reading: measurement && reading(measurement, scene, (at) => monotonicOf(clock, at)),
    readingAt: measurement && Math.min(now, Date.parse(measurement.captured_at)),
    missing: null,
    missingAt: null,
  };
}

/** A whole measurement says something of the spacing where frame after frame is not read, and by a frame that is newer. */
function withMeasurement(state: State, measurement: Measurement, now: number): Partial<State> {
  const newest = reading(measurement, sceneOf(state.bench), (at) => monotonicOf(state.clock, at));
  if (newest.capturedAt < setUpAt(state.bench)) return {};
  const word = wordOf(state);
  const says = !word || word.of === "measurement" || wordAge(state, word, now) > word.oldMs;
  return says && newest.capturedAt >= (word?.capturedAt ?? -Infinity) ? withReading(state, newest, now) : {};
}

/** `sentAt` is this page's clock, ms. */
function withReading(state: State, newest: Reading, sentAt: number) {
  const { single, targetPx } = newest;
  return {
    reading: newest,
    readingAt: sentAt,
    missing: null,
    missingAt: null,
    best: bestWith(state.best, newest),
    spacings: follow(
      state.spacings,
      pageTime(state, newest, sentAt) / 1000,
      { ...single, targetPx },
      spacingWeight,
    ),
  };
}

/** The state with what the meter says of a frame, which came at `now` of this page's clock. */
export function receiveReading(state: State, read: FrameReading, now: number): State {
  const heard = { ...state, heardAt: now, framesLeftOut: read.framesLeftOut, widthPx: read.widthPx };
  if (read.capturedAt < setUpAt(state.bench)) return heard;
  const newest = frameReading(
    read,
    state.measurement,
    sceneOf(state.bench),
    setUpAt(state.bench),
    state.reading,
  );
  const takenAt = now - read.ageMs;
  return newest
    ? { ...heard, ...withReading(state, newest, takenAt) }
    : { ...heard, missing: missing(read, state.missing), missingAt: takenAt };
}

function withAxes(state: State, bench: Bench, now: number): Trail<AxesPoint> {
  const of = (name: "focus" | "e") => {
    const axis = bench.axes.find((axis) => axis.axis === name);
    return axis ? placeOf(axis) : null;
  };
  return follow(state.axes, now / 1000, { focusMm: of("focus"), eMm: of("e") }, axesWeight);
}

/** The state with the last two minutes as the daemon knows them, which came at `now`: a page that was just opened has not
 *  seen them, nor has one that was cut off. */
export function remember(state: State, recent: Recent, now: number): State {
  const aheadMs = now - Date.parse(recent.now);
  const trail = <Then extends { at: string }, Point>(all: Then[], point: (then: Then) => Point) => ({
    at: all.map(({ at }) => (Date.parse(at) + aheadMs) / 1000),
    points: all.map(point),
  });
  const positions = trail(recent.positions, ({ focus_mm, e_mm }) => ({
    focusMm: focus_mm ?? null,
    eMm: e_mm ?? null,
  }));
  const spacings = trail(recent.spacings, (then) => ({
    spacingPx: then.spacing_px,
    sigmaPx: then.spacing_sigma_px,
    targetPx: then.spacing_target_px,
  }));
  return {
    ...state,
    axes: filled(state.axes, positions),
    spacings: filled(state.spacings, spacings),
    clarities: filled(
      state.clarities,
      trail(recent.clarities, ({ eog }) => eog ?? null),
    ),
  };
}

/** That a stop was not delivered is over once it is known whether the bench is stopped; where it is not, that is said. */
function withOutage({ stopFailed }: State, { stop }: Bench, isNews: boolean): Partial<State> {
  // Tried again, it may have got through after all.
  if (stop.latched && !stop.unread) return { stopFailed: null, notStopped: false };
  if (stopFailed === null || stop.unread) return {};
  // While the connection lasts, it may still be on its way.
  return isNews ? { stopFailed: null, notStopped: true } : {};
}

/** A stop that has been reset is over. */
function withStop(state: State, bench: Bench): State["stopSent"] {
  return state.bench?.stop.latched && !bench.stop.latched ? null : state.stopSent;
}

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

/** The jobs with one replaced, if what came is newer, or added. */
function withJob(jobs: Job[], job: Job): Job[] {
  const at = jobs.findIndex((other) => other.id === job.id);
  if (at < 0) return [...jobs, job];
  const old = jobs[at];
  if (old && old.generation > job.generation) return jobs;
  return jobs.map((other, index) => (index === at ? job : other));
}

/** What the daemon says of a frame that no picture can be made of. */
const NOT_VIEWABLE = "urn:plenalign:problem:not-viewable";

/** The state with a picture that the daemon sent at `sentAt` of this page's clock. */
export function receivePicture(state: State, picture: PictureFacts, sentAt: number, now: number): State {
  const { picture: before, pictureAt } = state;
  const known = before?.show === picture.show && pictureAt !== null;
  // After a pause the one before says nothing of when the next will come.
  const sinceMs = known ? Math.min(sentAt - pictureAt, MOST_AGES * picture.ageMs) : picture.ageMs;
  // The age that one has when the next takes its place.
  const usualMs = picture.show === "raw" ? 0 : picture.ageMs + sinceMs;
  const pictureOldMs = Math.max(STALE_MS, Math.min(OLDEST_MS, LATE * usualMs));
  // There is one again: that of an earlier frame none could be made is over.
  const problem = state.problem?.type === NOT_VIEWABLE ? null : state.problem;
  return { ...state, heardAt: now, picture, pictureAt: sentAt, pictureOldMs, problem };
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

function wordOf({ missing, missingAt, reading, readingAt }: State): Word | null {
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
function pageTime(state: State, of: Pick<Reading, "capturedAt" | "monotonicMs">, otherwise: number): number {
  const aheadMs = ahead(state.clock);
  if (of.monotonicMs === null) return wallTime(state, of.capturedAt, otherwise);
  return aheadMs === null ? otherwise : of.monotonicMs + aheadMs;
}

/** The same by the daemon's wall clock, where nothing else is said of when. */
function wallTime(state: State, capturedAt: number, otherwise: number): number {
  const aheadMs = aheadOfWall(state.clock);
  return aheadMs === null ? otherwise : capturedAt + aheadMs;
}

/** Since its frame was taken where the daemon's clock is known, or since it was sent, ms. */
function wordAge(state: State, word: Word, now: number): number {
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
