import { useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { moment } from "../../words/format";
import { may } from "../../state";
import { strings } from "../../strings";
import type { AuditEntry } from "../../daemon/wire";
import type { Given } from "../given";

/** Where more is to be read: the API's documentation, and who did what. */
export function Records(given: Given) {
  const words = strings.settings;
  return (
    <section class="card records" aria-label={words.records}>
      <h2>{words.records}</h2>
      <p>
        <a href="/api/v1/docs" target="_blank" rel="noopener">
          {words.apiDocs}
        </a>{" "}
        <span class="quiet">{words.apiDocsMore}</span>
      </p>
      {may(given.state, "admin") && <Audit {...given} />}
    </section>
  );
}

function Audit(given: Given) {
  const [entries, setEntries] = useState<AuditEntry[]>([]);
  const [next, setNext] = useState<string | null>(null);
  const load = (cursor: string | null, had: AuditEntry[]) =>
    given.load(
      api.audit(cursor).then((result) => {
        if (result.ok) {
          setEntries([...had, ...result.value.entries]);
          setNext(result.value.next ?? null);
        }
        return result;
      }),
    );
  const words = strings.settings;
  return (
    <details id="audit" onToggle={(event) => event.currentTarget.open && void load(null, [])}>
      <summary>{words.audit}</summary>
      <div class="table" tabIndex={0} role="region" aria-label={words.audit}>
        <table>
          <thead>
            <tr>
              {words.auditHeads.map((head) => (
                <th key={head} scope="col">
                  {head}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {entries.map(({ at, who, what, detail, from }, index) => (
              <tr key={index}>
                <td>{moment(at)}</td>
                <td>{who}</td>
                <td>{what}</td>
                <td>{from ?? ""}</td>
                <td class="words">
                  <code>{JSON.stringify(detail)}</code>
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {next !== null && (
        <button type="button" onClick={() => void load(next, entries)}>
          {words.auditOlder}
        </button>
      )}
    </details>
  );
}
