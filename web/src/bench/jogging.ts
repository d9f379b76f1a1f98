// The page's one jog, and what lets go of it besides the finger.

import { useEffect, useState } from "preact/hooks";
import * as api from "../daemon/api";
import { Jog, type Press } from "./jog";
import type { Problem } from "../daemon/wire";

const watchers = new Set<(press: Press | null) => void>();
let tell: (problem: Problem) => void = () => undefined;

const problemOf = (result: api.Result<unknown>) => (result.ok ? null : result.problem);

export const jog = new Jog({
  go: async ({ axis, towards, speedMmPerS }, name) =>
    problemOf(await api.jog(axis, towards, speedMmPerS, name)),
  end: async (axis) => problemOf(await api.endJog(axis)),
  failed: (problem) => tell(problem),
  changed: (press) => watchers.forEach((watcher) => watcher(press)),
});

/** A window that nobody looks at any more holds nothing. */
export function watchJog(failed: (problem: Problem) => void): void {
  tell = failed;
  window.addEventListener("blur", () => jog.release());
  window.addEventListener("pagehide", () => jog.release());
  document.addEventListener("visibilitychange", () => jog.release());
}

/** What is pressed now. */
export function useJog(): Press | null {
  const [press, setPress] = useState<Press | null>(jog.pressed);
  useEffect(() => {
    watchers.add(setPress);
    return () => void watchers.delete(setPress);
  }, []);
  return press;
}
