import { fixed, withSigma } from "../../format";
import { strings } from "../../strings";
import type { Iteration, Job } from "../../wire";
import { Convergence } from "./convergence";

/** What a job measured and decided, on a chart and in a table, and its log. */
export function Iterations({ job }: { job: Job }) {
  if (job.iterations.length === 0 && job.log.length === 0) return null;
  return (
    <section class="card iterations" aria-label={strings.iterations.title}>
      <h2>{strings.iterations.title}</h2>
      {job.iterations.length > 0 ? <Table job={job} /> : <p class="quiet">{strings.iterations.none}</p>}
      <details>
        <summary>{strings.iterations.log}</summary>
        <ol class="log">
          {job.log.map((line, index) => (
            <li key={index}>
              <time>{new Date(line.at).toLocaleTimeString()}</time> {line.message}
            </li>
          ))}
        </ol>
      </details>
    </section>
  );
}

function Table({ job }: { job: Job }) {
  return (
    <>
      <Convergence key={job.id} job={job} />
      <div class="table">
        <table>
          <thead>
            <tr>
              {Object.values(strings.iterations.columns).map((name) => (
                <th key={name}>{name}</th>
              ))}
            </tr>
          </thead>
          <tbody>
            {job.iterations.map((it) => (
              <Row key={it.number} it={it} />
            ))}
          </tbody>
        </table>
      </div>
    </>
  );
}

/** A readback in mm. */
function readback(position: number | null | undefined): string {
  return position === null || position === undefined ? "—" : fixed(position, 3);
}

function Row({ it }: { it: Iteration }) {
  return (
    <tr>
      <td>{it.number}</td>
      <td>{strings.iterations.stages[it.stage]}</td>
      <td>{strings.iterations.kinds[it.kind]}</td>
      <td>{withSigma(it.delta_v_mm, it.delta_v_sigma_mm, 4) ?? "—"}</td>
      <td>{withSigma(it.e_estimate_mm, it.e_estimate_sigma_mm, 3) ?? "—"}</td>
      <td>{withSigma(it.spacing.spacing_px, it.spacing.spacing_sigma_px, 4)}</td>
      <td>{fixed(it.spacing_target_px, 4)}</td>
      <td>{readback(it.focus_mm)}</td>
      <td>{readback(it.e_mm)}</td>
      <td class="words">{it.decision}</td>
    </tr>
  );
}
