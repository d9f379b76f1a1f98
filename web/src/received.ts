// How the daemon's messages change the page's one state. Pure.

import { clockAfter, monotonicOf, type Clock } from "./daemon/clock";
import { bestWith, frameReading, isOfSeveral, missing, reading, type Reading } from "./meter/reading";
import { sceneOf, setUpAt, type Scene } from "./meter/set-up";
import { placeOf } from "./bench/travel";
import {
  axesWeight,
  clarityWeight,
  filled,
  follow,
  spacingWeight,
  type AxesPoint,
  type Trail,
} from "./charts/trail";
import { pageTime, STALE_MS, wallTime, wordAge, wordOf, type State } from "./state";
import { NO_ANSWER } from "./daemon/no-answer";
import { isOver } from "./daemon/over";
import type {
  Bench,
  FrameReading,
  Job,
  Measurement,
  PictureFacts,
  Recent,
  ServerMessage,
} from "./daemon/wire";

/** What is made of a frame takes its time: it is old once the next one is late by this many times as long as that takes, and
 *  at this age however long it takes, ms. */
const LATE = 1.5;
/** Two pictures of a kind follow one another within so many times the age of one, at most. */
const MOST_AGES = 10;
const OLDEST_MS = 30_000;

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
    // What is of several levels or boards is none of their spacings.
    spacings: isOfSeveral(newest)
      ? state.spacings
      : follow(
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
