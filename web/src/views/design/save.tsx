import { useEffect, useState } from "preact/hooks";
import * as api from "../../api";
import type { JsonObject } from "../../config-schema";
import { count, laidOver } from "../../draft";
import { may } from "../../state";
import { strings } from "../../strings";
import { reworded } from "../../units";
import type { Sections } from "../../water";
import type { ConfigFault, ConfigWritten } from "../../wire";
import type { Given } from "../given";

interface Props extends Given {
  changes: Sections;
  wrong: boolean;
  working: boolean;
  obstacles: ConfigFault[];
}

/** The file as it was when this page read it. */
interface Read {
  stored: JsonObject | null;
  etag: string | null;
  /** What is in it and waits for the daemon's next start. */
  waiting: string[];
}

/** Writes the draft into the configuration's file, or says why it cannot be. */
export function Save({ state, act, changes, wrong, working, obstacles }: Props) {
  const [read, setRead] = useState<Read | null>(null);
  const [written, setWritten] = useState<ConfigWritten | null>(null);
  const load = async () => {
    const result = await api.config();
    if (result.ok)
      setRead({
        stored: (result.value.stored ?? null) as JsonObject | null,
        etag: result.etag ?? null,
        waiting: result.value.restart_required,
      });
  };
  useEffect(() => void load(), [state.bootId]);
  useEffect(() => setWritten(null), [JSON.stringify(changes)]);

  const words = strings.design;
  const nothing = count(changes) === 0;
  const because = !may(state, "admin")
    ? words.blocked.admin
    : state.link !== "open"
      ? words.blocked.link
      : read?.stored === null
        ? words.blocked.file
        : nothing
          ? words.blocked.nothing
          : wrong
            ? words.blocked.wrong
            : working
              ? words.blocked.working
              : obstacles.length > 0
                ? words.blocked.obstacles
                : state.bench?.job
                  ? words.blocked.job
                  : null;
  const save = async () => {
    if (!read?.stored || read.etag === null) return;
    await act(
      api.writeConfig(laidOver(read.stored, changes), read.etag).then((result) => {
        if (result.ok) setWritten(result.value);
        return result;
      }),
    );
    // Also where the file had been changed by somebody else: the next attempt is on what it says now.
    await load();
  };
  return (
    <div class="save">
      <button
        type="button"
        id="save"
        class="primary"
        disabled={because !== null || read === null}
        aria-describedby="save-more"
        onClick={() => void save()}
      >
        {words.save}
      </button>
      <p class="quiet" id="save-more" role="status">
        {because ?? words.saveMore}
      </p>
      {because === words.blocked.obstacles &&
        obstacles.map((obstacle) => (
          <p class="fault" key={obstacle.key + obstacle.message}>
            <b>{obstacle.key}</b> <span lang="en">{reworded(obstacle.message, state.preferences.unit)}</span>
          </p>
        ))}
      {written === null && read !== null && read.waiting.length > 0 && (
        <p class="notice">{strings.settings.restart(read.waiting.join(", "))}</p>
      )}
      {written && (
        <p class="notice" role="status">
          {written.changed.length > 0 ? words.saved(written.changed.join(", ")) : words.savedNothing}
        </p>
      )}
    </div>
  );
}
