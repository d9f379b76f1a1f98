import { useEffect, useState } from "preact/hooks";

/**
 * What somebody is asked about, and how to ask. A question that may not be answered any more is gone for good: nobody is to
 * come upon its answer when the connection, control or the axis is back.
 */
export function useAsked<T>(allowed: boolean): [T | null, (about: T | null) => void] {
  const [about, ask] = useState<T | null>(null);
  useEffect(() => {
    if (!allowed) ask(null);
  }, [allowed]);
  return [allowed ? about : null, ask];
}
