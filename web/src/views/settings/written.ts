import { strings } from "../../strings";
import type { ConfigWritten } from "../../daemon/wire";

/** What has been written into the configuration's file, and from when on it holds; null where nothing has changed. */
export function whatIsWritten({ changed, restart_required }: ConfigWritten): string | null {
  if (changed.length === 0) return null;
  const { written, writtenBack } = strings.settings;
  const isAwaited = changed.some((key) => restart_required.includes(key));
  return (isAwaited ? written : writtenBack)(changed.join(", "));
}
