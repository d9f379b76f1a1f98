import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import {
  isBelow,
  keysOf,
  same,
  tableOf,
  valueAt,
  withValue,
  type Json,
  type JsonObject,
  type Table,
} from "../../design/config-schema";
import { overtaken, rebased } from "../../design/draft";
import { may } from "../../state";
import { strings } from "../../strings";
import type { ConfigCheck, ConfigView, ConfigWritten } from "../../daemon/wire";
import { useAgain } from "../again";
import type { Given } from "../given";
import { ConfigTable, type Editing } from "./config-table";
import { whatIsWritten } from "./written";

/** Before what is typed is checked, ms. */
const REST_MS = 400;

/** The bench's configuration, key by key. */
export function Configuration({ state, act, load: ask }: Given) {
  const [view, setView] = useState<ConfigView | null>(null);
  const [etag, setEtag] = useState<string | null>(null);
  const [table, setTable] = useState<Table | null>(null);
  const [draft, setDraft] = useState<JsonObject | null>(null);
  const [check, setCheck] = useState<ConfigCheck | null>(null);
  const [written, setWritten] = useState<ConfigWritten | null>(null);
  /** Keys that are being changed here and have been changed elsewhere since. */
  const [lost, setLost] = useState<string[]>([]);
  const [find, setFind] = useState("");
  const stored = (view?.stored ?? null) as JsonObject | null;

  const take = (read: ConfigView, etag: string | null) => {
    // A file that cannot be read now is shown as it was.
    const now = (read.stored ?? stored) as JsonObject | null;
    setView({ ...read, stored: now });
    setEtag(etag);
    // What is being edited stays so, whoever starts the daemon again or writes the file.
    setDraft((before) => now && rebased(before, stored, now));
    if (draft && stored && now) {
      const also = overtaken(
        draft,
        stored,
        now,
        keys.map((key) => key.path),
      );
      setLost((before) => [...new Set([...before, ...also])]);
    }
    setCheck(null);
  };
  const keys = table ? keysOf(table) : [];
  const load = () =>
    ask(
      api.config().then((result) => {
        if (result.ok) take(result.value, result.etag ?? null);
        return result;
      }),
    );
  useEffect(() => {
    void load();
    void api.configSchema().then((result) => result.ok && setTable(tableOf(result.value)));
  }, [state.bootId]);
  useAgain(state.link === "open" && view !== null, async () => {
    const result = await api.config();
    if (!result.ok || (result.etag ?? null) === etag) return;
    take(result.value, result.etag ?? null);
    // It may hold no more.
    setWritten(null);
  });

  const changed = keys.filter(
    (key) => draft && !same(valueAt(draft, key.path), valueAt(stored ?? {}, key.path)),
  );
  const admin = may(state, "admin");
  useEffect(() => {
    setCheck(null);
    if (draft === null || changed.length === 0) return undefined;
    let wanted = true;
    const timer = setTimeout(() => {
      void ask(
        api.checkConfig(draft).then((result) => {
          if (result.ok && wanted) setCheck(result.value);
          return result;
        }),
      );
    }, REST_MS);
    return () => {
      wanted = false;
      clearTimeout(timer);
    };
  }, [draft]);

  if (!view || !table) return null;
  const busy = Boolean(state.bench?.job);
  const barred = changed.length === 0 || !check?.valid || etag === null || state.link !== "open" || busy;
  const apply = async () => {
    if (barred || draft === null) return;
    const ok = await act(
      api.writeConfig(draft, etag).then((result) => {
        if (result.ok) {
          setWritten(result.value);
          setLost([]);
        }
        return result;
      }),
    );
    if (ok) await load();
  };
  const editing: Editing = {
    draft: draft ?? (view.config as JsonObject),
    stored,
    faults: check?.problems ?? [],
    editable: (path) => admin && draft !== null && !isBelow(path, view.locked),
    isLocked: (path) => isBelow(path, view.locked),
    set: (path: string, value: Json) => {
      setWritten(null);
      setDraft((before) => before && withValue(before, path, value));
    },
    find: find.trim().toLowerCase(),
  };
  const replaced = lost.filter((path) => changed.some((key) => key.path === path));
  const strays = check?.problems.filter((fault) => !keys.some((key) => isBelow(fault.key, [key.path]))) ?? [];
  return (
    <section class="card configuration" aria-label={strings.settings.config}>
      <h2>{strings.settings.config}</h2>
      <p class="quiet">
        {view.file
          ? `${strings.settings.configFile(view.file)}. ${strings.settings.configMore}`
          : strings.settings.configNone}
        {!admin && ` ${strings.settings.configAdmin}`}
      </p>
      {view.fault && (
        <p class="notice wrong" role="alert" lang="en">
          {view.fault}
        </p>
      )}
      {view.restart_required.length > 0 && (
        <p class="notice">{strings.settings.restart(view.restart_required.join(", "))}</p>
      )}
      <label class="find">
        <span>{strings.settings.find}</span>
        <input type="search" value={find} onInput={(event) => setFind(event.currentTarget.value)} />
      </label>
      <ConfigTable table={table} {...editing} />
      {draft !== null && admin && (
        <div class="apply" data-changed={changed.length > 0}>
          <p role="status">
            {changed.length === 0 ? strings.settings.unchanged : strings.settings.changed(changed.length)}{" "}
            {changed.length > 0 &&
              (check === null
                ? strings.settings.checking
                : check.valid
                  ? strings.settings.valid
                  : strings.settings.faults(check.problems.length))}
          </p>
          {strays.map((fault) => (
            <p class="fault" key={fault.key}>
              <b>{fault.key}</b> <span lang="en">{fault.message}</span>
            </p>
          ))}
          {replaced.length > 0 && (
            <p class="notice wrong" role="alert">
              {strings.settings.overtaken(
                replaced.map((path) => `${path} = ${JSON.stringify(valueAt(stored ?? {}, path))}`).join(", "),
              )}
            </p>
          )}
          {check?.notices.map((notice) => (
            <p class="notice" lang="en" key={notice}>
              {notice}
            </p>
          ))}
          {written && <p class="notice">{whatIsWritten(written)}</p>}
          {busy && changed.length > 0 && <p class="quiet">{strings.design.blocked.job}</p>}
          <p class="actions">
            <button
              type="button"
              id="apply"
              class="primary"
              // Whoever pressed it is still there once nothing more is changed.
              aria-disabled={barred}
              onClick={() => void apply()}
            >
              {strings.settings.apply}
            </button>
            <button
              type="button"
              aria-disabled={changed.length === 0}
              onClick={() => changed.length > 0 && setDraft(stored)}
            >
              {strings.settings.revert}
            </button>
          </p>
        </div>
      )}
    </section>
  );
}
