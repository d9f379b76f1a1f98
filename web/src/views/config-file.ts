import { useEffect } from "preact/hooks";
import * as api from "../daemon/api";
import type { ConfigFile } from "../design/draft";
import type { JsonObject } from "../design/config-schema";
import { useAgain } from "./again";
import type { Given } from "./given";
import { useKept } from "./kept";

/** What the configuration's file holds now, which others may change; null until it has been read. */
export function useConfigFile(given: Given): { file: ConfigFile | null; read: () => Promise<void> } {
  const { state, newest: stateNow } = given;
  const [file, setFile] = useKept(given, "configFile");
  const connected = state.link === "open";
  const read = async () => {
    const result = await api.config();
    if (!result.ok || stateNow().session === "stranger") return;
    const { stored, restart_required: waiting, fault = null } = result.value;
    const etag = result.etag ?? null;
    const read = { stored: (stored ?? null) as JsonObject | null, etag, fault, waiting };
    if (JSON.stringify(read) !== JSON.stringify(stateNow().configFile)) setFile(read);
  };
  useAgain(connected, read);
  useEffect(() => {
    if (connected) void read();
  }, [state.bootId, connected]);
  return { file, read };
}
