// Requests to the daemon. Each returns a tagged result, so that every caller has to look at failure.

import { strings } from "./strings";
import type { AxisName, Bench, Job, Problem, ShellState, StopReport } from "./wire";

export type Result<T> = { ok: true; value: T } | { ok: false; problem: Problem };

const TIMEOUT_MS = 8000;

async function request<T>(method: string, path: string, body?: unknown): Promise<Result<T>> {
  const init: RequestInit = { method, signal: AbortSignal.timeout(TIMEOUT_MS) };
  if (body !== undefined) {
    init.headers = { "content-type": "application/json" };
    init.body = JSON.stringify(body);
  }
  try {
    const response = await fetch(path, init);
    const value: unknown = await response.json();
    if (response.ok) return { ok: true, value: value as T };
    return { ok: false, problem: value as Problem };
  } catch (error) {
    const detail = error instanceof Error ? error.message : String(error);
    return { ok: false, problem: { type: "about:blank", title: strings.noAnswer, status: 0, detail } };
  }
}

export const startAlignment = () => request<Job>("POST", "/api/v1/jobs", { kind: "joint_alignment" });
export const cancelJob = (job: Job) => request<Job>("DELETE", job.href);
export const confirmStep = (job: Job, step: number) => request<Job>("POST", `${job.href}/confirm`, { step });
export const stopAll = () => request<StopReport>("POST", "/api/v1/stop");
export const resetStop = () => request<Bench["stop"]>("DELETE", "/api/v1/stop");
export const home = (axis: AxisName) => request<Bench>("POST", `/api/v1/axes/${axis}/home`);
export const move = (axis: AxisName, position_mm: number) =>
  request<Bench>("POST", `/api/v1/axes/${axis}/move`, { position_mm });
export const setShell = (state: ShellState) => request<Bench>("PUT", "/api/v1/shell", { state });
