import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { count, laidOver, type ConfigFile } from "../../design/draft";
import { may } from "../../state";
import { strings } from "../../strings";
import { reworded } from "../../words/units";
import type { Sections } from "../../design/water";
import type { ConfigFault, ConfigWritten } from "../../daemon/wire";
import { whatIsWritten } from "../settings/written";
import type { Given } from "../given";

/** The status of a file that is no more as it was read. */
const CHANGED = 412;

interface Props extends Given {
  /** Null until it has been read. */
  file: ConfigFile | null;
  /** Reads it again. */
  read: () => Promise<void>;
  changes: Sections;
  wrong: boolean;
  working: boolean;
  obstacles: ConfigFault[];
}

/** Writes the draft into the configuration's file, or says why it cannot be. */
export function Save({ state, act, file, read, changes, wrong, working, obstacles }: Props) {
  const [written, setWritten] = useState<ConfigWritten | null>(null);
  const [overtaken, setOvertaken] = useState(false);
  const nothing = count(changes) === 0;
  useEffect(() => {
    if (!nothing) setWritten(null);
  }, [JSON.stringify(changes)]);

  const words = strings.design;
  const because = !may(state, "admin")
    ? words.blocked.admin
    : state.link !== "open"
      ? words.blocked.link
      : file?.stored === null
        ? (file.fault ?? words.blocked.file)
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
  const barred = because !== null || file === null;
  const save = async () => {
    if (barred || !file.stored || file.etag === null) return;
    const result = await api.writeConfig(laidOver(file.stored, changes), file.etag);
    if (result.ok) setWritten(result.value);
    const changed = !result.ok && result.problem.status === CHANGED;
    setOvertaken(changed);
    if (!changed) await act(Promise.resolve(result));
    // Also where the file had been changed by somebody else: the next attempt is on what it says now.
    await read();
  };
  return (
    <div class="save">
      <button
        type="button"
        id="save"
        class="primary"
        // Whoever pressed it is still there once there is nothing more to be saved.
        aria-disabled={barred}
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
      {overtaken && !nothing && (
        <p class="notice wrong" role="alert">
          {words.overtaken}
        </p>
      )}
      {written === null && file !== null && file.waiting.length > 0 && (
        <p class="notice">{strings.settings.restart(file.waiting.join(", "))}</p>
      )}
      {written && (
        <p class="notice" role="status">
          {whatIsWritten(written) ?? words.savedNothing}
        </p>
      )}
    </div>
  );
}
