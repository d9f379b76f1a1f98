// Requests to the daemon. Each returns a tagged result, so that every caller has to look at failure.

import { LeaseKeeper } from "./lease";
import { strings } from "./strings";
import type { AxisName, Bench, Job, Problem, ShellState, StopReport } from "./wire";

export type Result<T> = { ok: true; value: T } | { ok: false; problem: Problem };

const TIMEOUT_MS = 8000;

async function request<T>(
  method: string,
  path: string,
  body?: unknown,
  leaseKey?: string,
): Promise<Result<T>> {
  const headers: Record<string, string> = {};
  const init: RequestInit = { method, headers, signal: AbortSignal.timeout(TIMEOUT_MS) };
  if (leaseKey !== undefined) headers["plenalign-lease"] = leaseKey;
  if (body !== undefined) {
    headers["content-type"] = "application/json";
    init.body = JSON.stringify(body);
  }
  try {
    const response = await fetch(path, init);
    const value: unknown = response.status === 204 ? null : await response.json();
    if (response.ok) return { ok: true, value: value as T };
    return { ok: false, problem: value as Problem };
  } catch (error) {
    const detail = error instanceof Error ? error.message : String(error);
    return { ok: false, problem: { type: "about:blank", title: strings.noAnswer, status: 0, detail } };
  }
}

export const lease = new LeaseKeeper(request, () => strings.leaseOwner, sessionStorage);

export const startAlignment = () => lease.command<Job>("POST", "/api/v1/jobs", { kind: "joint_alignment" });
export const cancelJob = (job: Job) => request<Job>("DELETE", job.href);
export const confirmStep = (job: Job, step: number) => request<Job>("POST", `${job.href}/confirm`, { step });
export const stopAll = () => request<StopReport>("POST", "/api/v1/stop");
export const resetStop = () => request<Bench["stop"]>("DELETE", "/api/v1/stop");
export const home = (axis: AxisName) => lease.command<Bench>("POST", `/api/v1/axes/${axis}/home`);
export const move = (axis: AxisName, position_mm: number) =>
  lease.command<Bench>("POST", `/api/v1/axes/${axis}/move`, { position_mm });
export const setShell = (state: ShellState) => lease.command<Bench>("PUT", "/api/v1/shell", { state });
export const takeLease = async (): Promise<Result<null>> => {
  const problem = await lease.take();
  return problem ? { ok: false, problem } : { ok: true, value: null };
};
export const releaseLease = async (): Promise<Result<null>> => {
  await lease.release();
  return { ok: true, value: null };
};
