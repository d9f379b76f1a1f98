import { useEffect, useState } from "preact/hooks";

/** So long a question takes no answer, ms: a second click, or a second Enter, was meant for what stood there before. */
const SETTLE_MS = 500;

/** Whether what is named by `key` has been in sight long enough to be answered; null while nothing is. */
export function useSettled(key: string | number | null): boolean {
  const [settled, settle] = useState<typeof key>(null);
  useEffect(() => {
    if (key === null) return settle(null);
    const timer = setTimeout(() => settle(key), SETTLE_MS);
    return () => clearTimeout(timer);
  }, [key]);
  return key !== null && settled === key;
}

/** Has a key that is held down press a button once. */
export function onceHeld(event: KeyboardEvent): void {
  if (event.repeat && event.key === "Enter") event.preventDefault();
}
