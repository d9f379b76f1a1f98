// The page's one state, and how messages change it. Pure: views draw from it, tests feed it.

import { ahead, heard as heardTick, unknown, type Clock } from "./clock";
import { best, type Best } from "./reading";
import { routeOf, type Route } from "./route";
import { standard, type Preferences } from "./preferences";
import { follow, noTrail, type AxesPoint, type SpacingPoint, type Trail } from "./trail";
import type {
  Bench,
  Design,
  Job,
  JobState,
  Measurement,
  PictureFacts,
  Problem,
  Scope,
  ServerMessage,
  Session,
  StopReport,
  StopReset,
} from "./wire";

export type Link = "connecting" | "open" | "lost";

export interface State {
  /** Who one is to the daemon; "stranger" where it asks for a token; null before it has said. */
  session: Session | "stranger" | null;
  link: Link;
  /** When a lost connection is tried again, this page's clock, ms; null while it is being tried. */
  retryAt: number | null;
  bootId: string | null;
  seq: number;
  version: string | null;
  bench: Bench | null;
  /** Newest last. */
  jobs: Job[];
  measurement: Measurement | null;
  clock: Clock;
  /** This page's clock when the measurement came, ms. */
  measurementAt: number | null;
  picture: PictureFacts | null;
  /** This page's clock when the picture was sent, ms. */
  pictureAt: number | null;
  /** This page's clock when anything came, ms. */
  heardAt: number | null;
  /** The newest thing that went wrong, for the operator to read and dismiss. */
  problem: Problem | null;
  /** A stop that could not be delivered: nothing else hides it. */
  stopFailed: Problem | null;
  /** When the newest reset was that has been read and dismissed. */
  resetSeen: string | null;
  /** What became of a stop that this page sent, axis by axis, until it is reset. */
  stopSent: Pick<StopReport, "focus" | "e" | "kept"> | null;
  route: Route;
  preferences: Preferences;
  /** The design of the configured camera, where it has been asked for. */
  design: Design | null;
  /** The measurement closest to its target since this was reset. */
  best: Best | null;
  spacings: Trail<SpacingPoint>;
  axes: Trail<AxesPoint>;
}

export const initial: State = {
  session: null,
  link: "connecting",
  retryAt: null,
  bootId: null,
  seq: 0,
  version: null,
  bench: null,
  jobs: [],
  clock: unknown,
  measurement: null,
  measurementAt: null,
  picture: null,
  pictureAt: null,
  heardAt: null,
  problem: null,
  stopFailed: null,
  resetSeen: null,
  stopSent: null,
  route: routeOf(""),
  preferences: standard,
  design: null,
  best: null,
  spacings: noTrail,
  axes: noTrail,
};

/** Older than this, a picture does not show how things are, ms. */
export const STALE_MS = 2000;
/** Older than this, a measurement says how old it is: a frame takes a second or two to be taken and measured, ms. */
export const OLD_MEASUREMENT_MS = 5000;
/** Ticks come every 2 s: after this silence the connection counts as lost, ms. */
export const SILENCE_MS = 6000;

/** The state after a message. */
export function receive(state: State, message: ServerMessage, now: number): State {
  const heard = { ...state, heardAt: now, link: "open" as const };
  // Another start of the daemon: nothing of the old one holds.
  if (state.bootId !== null && message.boot_id !== state.bootId && message.type !== "snapshot") return heard;
  const seq = Math.max(message.seq, message.type === "snapshot" ? 0 : state.seq);
  switch (message.type) {
    case "snapshot":
      return {
        ...heard,
        seq,
        bootId: message.boot_id,
        clock: unknown,
        version: message.version,
        bench: message.bench,
        stopSent: withStop(state, message.bench),
        jobs: message.jobs,
        measurement: message.measurement ?? null,
        measurementAt: message.measurement
          ? Math.min(now, Date.parse(message.measurement.captured_at))
          : null,
        axes: withAxes(state, message.bench, now),
        ...(message.boot_id === state.bootId ? {} : { picture: null, pictureAt: null, best: null }),
      };
    case "bench":
      return {
        ...heard,
        seq,
        bench: message.bench,
        stopSent: withStop(state, message.bench),
        axes: withAxes(state, message.bench, now),
        // With the shell on it is another camera: what was best without says nothing.
        ...(state.bench && state.bench.shell !== message.bench.shell ? { best: null } : {}),
      };
    case "job":
      return { ...heard, seq, jobs: withJob(state.jobs, message.job) };
    case "measurement":
      return {
        ...heard,
        seq,
        measurement: message.measurement,
        measurementAt: now,
        best: best(state.best, message.measurement),
        spacings: follow(state.spacings, now / 1000, {
          spacingPx: message.measurement.spacing.spacing_px,
          sigmaPx: message.measurement.spacing.spacing_sigma_px,
          targetPx: message.measurement.spacing_target_px,
          eog: message.measurement.eog ?? null,
        }),
      };
    case "tick":
      return { ...heard, seq, clock: heardTick(state.clock, now, message.now) };
    case "gap":
      return { ...heard, seq };
    case "problem":
      return { ...heard, seq, problem: message.problem };
  }
}

function withAxes(state: State, bench: Bench, now: number): Trail<AxesPoint> {
  const of = (name: "focus" | "e") => {
    const axis = bench.axes.find((axis) => axis.axis === name);
    return axis?.homed ? (axis.position_mm ?? null) : null;
  };
  return follow(state.axes, now / 1000, { focusMm: of("focus"), eMm: of("e") });
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
  return now - (ahead(state.clock) ?? 0) - Date.parse(stop.reset.at) < NEWS_MS ? stop.reset : null;
}

/** The jobs with one replaced, if what came is newer, or added. */
function withJob(jobs: Job[], job: Job): Job[] {
  const at = jobs.findIndex((other) => other.id === job.id);
  if (at < 0) return [...jobs, job];
  const old = jobs[at];
  if (old && old.generation > job.generation) return jobs;
  return jobs.map((other, index) => (index === at ? job : other));
}

/** The state with a picture that the daemon sent at `sentAt` of this page's clock. */
export function receivePicture(state: State, picture: PictureFacts, sentAt: number, now: number): State {
  return { ...state, heardAt: now, picture, pictureAt: sentAt };
}

/** Age of the picture shown, ms. */
export function pictureAge(state: State, now: number): number | null {
  return state.picture && state.pictureAt !== null ? state.picture.ageMs + (now - state.pictureAt) : null;
}

/** Age of the measurement shown, ms: since its frame was taken where the daemon's clock is known, or since it came. */
export function measurementAge(state: State, now: number): number | null {
  if (!state.measurement || state.measurementAt === null) return null;
  const aheadMs = ahead(state.clock);
  if (aheadMs === null) return now - state.measurementAt;
  return Math.max(0, now - aheadMs - Date.parse(state.measurement.captured_at));
}

export type PictureState = "none" | "fresh" | "stale";

export function pictureState(state: State, now: number): PictureState {
  const age = pictureAge(state, now);
  if (age === null) return "none";
  return state.link === "open" && age <= STALE_MS ? "fresh" : "stale";
}

const FINAL: JobState[] = ["converged", "succeeded", "not_converged", "cancelled", "failed", "interrupted"];

export function isFinal(state: JobState): boolean {
  return FINAL.includes(state);
}

/** The job under way, or else the newest. */
export function currentJob(state: State): Job | null {
  const held = state.jobs.find((job) => job.id === state.bench?.job);
  return held ?? state.jobs[state.jobs.length - 1] ?? null;
}

const SCOPES: Scope[] = ["view", "control", "admin"];

/** Whether whoever uses the page may do what needs `scope`. */
export function may(state: State, scope: Scope): boolean {
  if (state.session === null || state.session === "stranger") return false;
  return SCOPES.indexOf(state.session.scope) >= SCOPES.indexOf(scope);
}
