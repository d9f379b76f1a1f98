// Requests to the daemon. Each returns a tagged result, so that every caller has to look at failure.

import { ConfirmKeys } from "./confirm-key";
import type { About } from "../picture/kept-picture";
import { LeaseKeeper } from "./lease";
import { me } from "../words/names";
import { noAnswer } from "./no-answer";
import type { Sections } from "../design/water";
import type {
  AuditList,
  AutoExposure,
  AxisName,
  Bench,
  ConfirmKeyGrant,
  ConfigCheck,
  ConfigView,
  ConfigWritten,
  ControlName,
  Design,
  Devices,
  Draft,
  DraftBase,
  FaultPlanInForce,
  Faults,
  FaultsChange,
  Histogram,
  Job,
  JobCreated,
  JobList,
  JobRequest,
  Light,
  NewToken,
  Plan,
  Problem,
  Recent,
  ShellState,
  Side,
  StopReport,
  Token,
  TokenList,
  TokenRequest,
} from "./wire";

export type Result<T> = { ok: true; value: T } | { ok: false; problem: Problem };

const TIMEOUT_MS = 8000;
/** A takeover waits for a job to end. */
const TAKEOVER_MS = 30_000;
/** A search for the exposure takes frame after frame; the daemon gives it up after a minute. */
const AUTO_EXPOSURE_MS = 70_000;
/** A camera's driver may take 5 s each time it is asked or told, and then some frames are let pass. */
const SET_LIGHT_MS = 30_000;
/** The daemon's deadman has ended a jog long before; a stop that is not answered by then is sent anew. */
const SHORT_MS = 3000;

const STOP = "/api/v1/stop";
const AUTO_EXPOSURE = "/api/v1/camera/auto-exposure";
const CONTROLS = "/api/v1/camera/controls";

interface Asked {
  body?: unknown;
  headers?: Record<string, string>;
  timeoutMs?: number;
}

async function exchange<T>(
  method: string,
  path: string,
  asked: Asked = {},
): Promise<Result<T> & { etag?: string }> {
  const headers: Record<string, string> = { ...asked.headers };
  const init: RequestInit = { method, headers, signal: AbortSignal.timeout(asked.timeoutMs ?? TIMEOUT_MS) };
  if (asked.body !== undefined) {
    headers["content-type"] = "application/json";
    init.body = JSON.stringify(asked.body);
  }
  try {
    const response = await fetch(path, init);
    const value: unknown = response.status === 204 ? null : await response.json();
    if (!response.ok) return { ok: false, problem: value as Problem };
    const etag = response.headers.get("etag");
    return { ok: true, value: value as T, ...(etag === null ? {} : { etag }) };
  } catch (error) {
    return { ok: false, problem: noAnswer(error) };
  }
}

/** The newest frame with the camera's own samples, as a PNG, and what its name says. */
export async function rawFrame(): Promise<Result<{ file: Blob; about: About }>> {
  try {
    const response = await fetch("/api/v1/frame.png", { signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (!response.ok) return { ok: false, problem: (await response.json()) as Problem };
    const said = (name: string) => response.headers.get(`plenalign-${name}`);
    const about = {
      kind: "raw" as const,
      capturedAt: new Date(said("captured-at") ?? NaN),
      seq: Number(said("frame-seq")),
      simulated: said("simulated") === "true",
      replayed: said("replayed") === "true",
      preview: said("preview") === "true",
    };
    return { ok: true, value: { file: await response.blob(), about } };
  } catch (error) {
    return { ok: false, problem: noAnswer(error) };
  }
}

function request<T>(method: string, path: string, body?: unknown, key?: string): Promise<Result<T>> {
  return exchange<T>(method, path, {
    body,
    timeoutMs: allowedMs(path),
    headers: key === undefined ? {} : { "plenalign-lease": key },
  });
}

function allowedMs(path: string): number {
  if (path.endsWith("/jog") || path.startsWith(STOP)) return SHORT_MS;
  if (path.endsWith("/takeover")) return TAKEOVER_MS;
  if (path.startsWith(CONTROLS)) return SET_LIGHT_MS;
  return path === AUTO_EXPOSURE ? AUTO_EXPOSURE_MS : TIMEOUT_MS;
}

export const lease = new LeaseKeeper(request, me, sessionStorage);
export const confirmKeys = new ConfirmKeys(sessionStorage);

const done = (problem: Problem | null): Result<null> =>
  problem ? { ok: false, problem } : { ok: true, value: null };
export const takeLease = async () => done(await lease.take());
export const takeOverLease = async () => done(await lease.takeOver());
export const releaseLease = async () => done(await lease.release());

/** Who asks, for what is asked without a body. */
const asker = () => new URLSearchParams({ owner: me() }).toString();
export const stopAll = () => request<StopReport>("POST", `${STOP}?${asker()}`);
export const resetStop = (why: string) => request<Bench["stop"]>("DELETE", STOP, { why, owner: me() });

export const home = (axis: AxisName) => lease.command<Bench>("POST", `/api/v1/axes/${axis}/home`);
export const leaveSwitch = (axis: AxisName, pressed: Side) =>
  lease.command<Bench>("POST", `/api/v1/axes/${axis}/leave-switch`, { pressed });
export const move = (axis: AxisName, position_mm: number) =>
  lease.command<Bench>("POST", `/api/v1/axes/${axis}/move`, { position_mm });
export const jog = (axis: AxisName, towards: Side, speed_mm_per_s: number | null, press: string) =>
  lease.repeat<Bench>("POST", `/api/v1/axes/${axis}/jog`, { towards, speed_mm_per_s, press });
export const endJog = (axis: AxisName) => request<Bench>("DELETE", `/api/v1/axes/${axis}/jog`);
export const setShell = (state: ShellState) => lease.command<Bench>("PUT", "/api/v1/shell", { state });

/** The camera's exposure and gain. */
export const light = () => request<Light>("GET", CONTROLS);
export const setLight = (control: ControlName, value: number) =>
  lease.command<Light>("PUT", `${CONTROLS}/${control}`, { value });
/** Finds the exposure for a white frame. */
export const autoExpose = () => lease.command<AutoExposure>("POST", AUTO_EXPOSURE);
/** The grey levels of the newest frame. */
export const histogram = () => request<Histogram>("GET", "/api/v1/camera/histogram");

export async function startJob(job: JobRequest): Promise<Result<Job>> {
  const started = await lease.command<JobCreated>("POST", "/api/v1/jobs", job);
  if (started.ok && started.value.confirm_key) {
    confirmKeys.keep({ job: started.value.id, key: started.value.confirm_key });
  }
  return started;
}
export const cancelJob = (job: Job) => request<Job>("DELETE", `${job.href}?${asker()}`);
const WRONG_KEY = "urn:plenalign:problem:confirm-key-wrong";

/** What shows that this tab may answer for a job: the key of its lease, its confirm key, or both. */
function shown(job: Job): Record<string, string> {
  const key = confirmKeys.of(job.id);
  return {
    ...(lease.key === null ? {} : { "plenalign-lease": lease.key }),
    ...(key === null ? {} : { "plenalign-confirm": key }),
  };
}

async function answer(job: Job, how: "confirm" | "repeat", step: number): Promise<Result<Job>> {
  const answered = await exchange<Job>("POST", `${job.href}/${how}`, { body: { step }, headers: shown(job) });
  if (!answered.ok && answered.problem.type === WRONG_KEY) confirmKeys.forget();
  return answered;
}

export const confirmStep = (job: Job, step: number) => answer(job, "confirm", step);
/** Asks for an earlier step again, in place of confirming the one that the job waits for. */
export const repeatStep = (job: Job, step: number) => answer(job, "repeat", step);

/** Makes another confirm key for a job; the one before is dead. */
export async function renewConfirmKey(job: Job): Promise<Result<ConfirmKeyGrant>> {
  const mine = lease.key;
  const headers: Record<string, string> = mine === null ? {} : { "plenalign-lease": mine };
  const made = await exchange<ConfirmKeyGrant>("POST", `${job.href}/confirm-key`, { headers });
  if (made.ok) confirmKeys.keep({ job: job.id, key: made.value.confirm_key });
  return made;
}

export const job = (id: string) => request<Job>("GET", `/api/v1/jobs/${id}`);
export const jobs = (query: URLSearchParams) => request<JobList>("GET", `/api/v1/jobs?${query.toString()}`);

/** The last two minutes, as far as somebody looked. */
export const recent = () => request<Recent>("GET", "/api/v1/recent");
export const design = () => request<Design>("GET", "/api/v1/design");
export const draftDesign = (base: DraftBase, sections: Sections) =>
  request<Draft>("POST", "/api/v1/design", { base, ...sections });
/** How the camera in force would be aligned, or one that is changed so. */
export const plan = (sections: Sections = {}) => request<Plan>("POST", "/api/v1/plan", sections);
export const devices = () => request<Devices>("GET", "/api/v1/devices");
function withChange(now: Faults, change: FaultsChange): Faults {
  const parts = Object.entries(now) as [keyof Faults, object][];
  return Object.fromEntries(
    parts.map(([part, of]) => [part, { ...of, ...change[part] }]),
  ) as unknown as Faults;
}

const FAULTS = "/api/v1/simulation/faults";
let before: Promise<unknown> = Promise.resolve();
/** One after the other: what is read is of after the changes before, and no change undoes another. */
function inTurn<T>(ask: () => Promise<T>): Promise<T> {
  const next = before.then(ask);
  before = next;
  return next;
}
const readFaults = () => request<Faults>("GET", FAULTS);
/** What is not named goes right. */
const setFaults = (faults: Partial<Faults>) => request<Faults>("PUT", FAULTS, faults);

export const faults = () => inTurn(readFaults);
/** The plan by which faults come and go by themselves; a change by hand ends it. */
export const faultPlan = () =>
  inTurn(() => request<FaultPlanInForce>("GET", "/api/v1/simulation/fault-plan"));
export const clearFaults = () => inTurn(() => setFaults({}));
/** What is not named stays as it is by now, which others may have changed. */
export const changeFaults = (change: FaultsChange) =>
  inTurn(async () => {
    const now = await readFaults();
    return now.ok ? setFaults(withChange(now.value, change)) : now;
  });
export const config = () => exchange<ConfigView>("GET", "/api/v1/config");
export const configSchema = () => request<unknown>("GET", "/api/v1/config/schema");
export const checkConfig = (config: unknown) =>
  request<ConfigCheck>("POST", "/api/v1/config/validate", { config });
export const writeConfig = (config: unknown, etag: string) =>
  exchange<ConfigWritten>("PUT", "/api/v1/config", { body: { config }, headers: { "if-match": etag } });

/** Who did what, newest first; on from where the page before has ended. */
export const audit = (cursor: string | null) =>
  request<AuditList>("GET", `/api/v1/audit${cursor === null ? "" : `?cursor=${encodeURIComponent(cursor)}`}`);
export const tokens = () => request<TokenList>("GET", "/api/v1/tokens");
export const makeToken = (token: TokenRequest) => request<NewToken>("POST", "/api/v1/tokens", token);
export const revokeToken = (token: Token) => request<null>("DELETE", token.href);
