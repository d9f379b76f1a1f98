import {
  keysOf,
  same,
  valueAt,
  type Json,
  type JsonObject,
  type Key,
  type Table,
} from "../../design/config-schema";
import { strings } from "../../strings";
import type { ConfigFault } from "../../daemon/wire";
import { ConfigField } from "./config-field";

/** What is being changed. */
export interface Editing {
  draft: JsonObject;
  stored: JsonObject | null;
  faults: ConfigFault[];
  editable: (path: string) => boolean;
  isLocked: (path: string) => boolean;
  set: (path: string, value: Json) => void;
  /** What is looked for, in small letters; empty for everything. */
  find: string;
}

function found(key: Key, find: string): boolean {
  return find === "" || key.path.toLowerCase().includes(find) || key.meaning.toLowerCase().includes(find);
}

/** What is wrong with a key, or within it. */
function wrongIn(key: Key, faults: ConfigFault[]): ConfigFault[] {
  return faults.filter(
    (fault) =>
      fault.key === key.path || fault.key.startsWith(`${key.path}.`) || fault.key.startsWith(`${key.path}[`),
  );
}

/** Whether a key is shown: what is wrong is, whatever is looked for. */
function shown(key: Key, { find, faults }: Editing): boolean {
  return found(key, find) || wrongIn(key, faults).length > 0;
}

/** A table of the configuration, with the tables in it. */
export function ConfigTable({ table, ...editing }: Editing & { table: Table }) {
  const keys = table.keys.filter((key) => shown(key, editing));
  return (
    <>
      {keys.map((key) => {
        const value = valueAt(editing.draft, key.path);
        return (
          <ConfigField
            key={key.path}
            of={key}
            value={value}
            changed={editing.stored !== null && !same(value, valueAt(editing.stored, key.path))}
            faults={wrongIn(key, editing.faults)}
            editable={editing.editable(key.path)}
            locked={editing.isLocked(key.path)}
            set={(value) => editing.set(key.path, value)}
          />
        );
      })}
      {table.tables.map((inner) => {
        const all = keysOf(inner);
        if (!all.some((key) => shown(key, editing))) return null;
        const wrong = editing.faults.filter((fault) => fault.key.startsWith(inner.path)).length;
        return (
          <details key={inner.path} open={editing.find !== "" || wrong > 0}>
            <summary>
              <b>{inner.name}</b>{" "}
              <span class="quiet" lang="en">
                {inner.meaning}
              </span>
              {wrong > 0 && <span class="tag bad">{strings.settings.faults(wrong)}</span>}
            </summary>
            <div class="inner">
              <ConfigTable table={inner} {...editing} />
            </div>
          </details>
        );
      })}
    </>
  );
}
