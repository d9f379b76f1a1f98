import { useEffect, useRef } from "preact/hooks";

/** Between two questions, ms. */
const AGAIN_MS = 3000;

/** Asks the daemon again and again for what others may change, in another browser or by hand, while the page is seen. */
export function useAgain(connected: boolean, ask: () => Promise<void>): void {
  const newest = useRef(ask);
  newest.current = ask;
  useEffect(() => {
    if (!connected) return undefined;
    const timer = setInterval(() => {
      if (document.visibilityState === "visible") void newest.current();
    }, AGAIN_MS);
    return () => clearInterval(timer);
  }, [connected]);
}
