import { useEffect, useState } from "preact/hooks";
import { fullScreen } from "../picture/full-screen";
import { strings } from "../strings";
import { Toggle } from "./toggle";

/** Whether the page has the whole screen, which Escape ends, too. */
export function useFullScreen(): boolean {
  const [on, set] = useState(fullScreen.on);
  useEffect(() => {
    const changed = () => set(fullScreen.on);
    document.addEventListener("fullscreenchange", changed);
    return () => document.removeEventListener("fullscreenchange", changed);
  }, []);
  return on;
}

/** Gives the page the whole screen; nothing where the browser has no such thing. */
export function FullScreen() {
  const on = useFullScreen();
  if (!fullScreen.possible) return null;
  return (
    <Toggle on={on} set={(wanted) => void fullScreen.set(wanted)}>
      {strings.meterPage.fullScreen}
    </Toggle>
  );
}
