import { clock, fixed, withSigma } from "../../words/format";
import { strings } from "../../strings";
import { bare, bareMeasured, reworded, type LengthUnit } from "../../words/units";
import type { Iteration, Job } from "../../daemon/wire";
import { Explained } from "../term";
import { Convergence } from "./convergence";
import { OverTime } from "./over-time";
import { ThroughFocus } from "./through-focus";

interface Props {
  job: Job;
  unit: LengthUnit;
}

/** What a job measured and decided, on a chart and in a table, and its log. */
export function Iterations({ job, unit }: Props) {
  if (job.iterations.length === 0 && job.log.length === 0) return null;
  return (
    <section class="card iterations" aria-label={strings.iterations.title}>
      <h2>{strings.iterations.title}</h2>
      {job.iterations.length > 0 ? (
        <Table job={job} unit={unit} />
      ) : (
        !job.ended_at && <p class="quiet">{strings.iterations.none}</p>
      )}
      <details>
        <summary>{strings.iterations.log}</summary>
        <ol class="log" tabIndex={0}>
          {job.log.map((line, index) => (
            <li key={index}>
              <time>{clock(line.at)}</time> <span lang="en">{reworded(line.message, unit)}</span>
            </li>
          ))}
        </ol>
      </details>
    </section>
  );
}

function Table({ job, unit }: Props) {
  return (
    <>
      <Chart key={job.id} job={job} unit={unit} />
      {job.report && <p class="quiet">{strings.iterations.byPictures}</p>}
      <div class="table" tabIndex={0} role="group" aria-label={strings.iterations.title}>
        <table>
          <thead>
            <tr>
              {Object.values(strings.iterations.columns).map((name) => {
                const text = typeof name === "string" ? name : name(unit);
                return (
                  <th key={text} scope="col">
                    <Explained text={text} />
                  </th>
                );
              })}
            </tr>
          </thead>
          <tbody>
            {job.iterations.map((it) => (
              <Row key={it.number} it={it} unit={unit} />
            ))}
          </tbody>
        </table>
      </div>
    </>
  );
}

function Chart({ job, unit }: Props) {
  switch (job.request.kind) {
    case "focus_sweep":
      return <ThroughFocus job={job} axis={job.request.axis} unit={unit} />;
    case "spacing_watch":
      return <OverTime job={job} />;
    default:
      return <Convergence job={job} />;
  }
}

function Row({ it, unit }: { it: Iteration; unit: LengthUnit }) {
  const readback = (mm: number | null | undefined) => (typeof mm === "number" ? bare(mm, unit) : "—");
  return (
    <tr data-discarded={it.discarded === true}>
      <td>{it.number}</td>
      <td>{strings.iterations.stages[it.stage]}</td>
      <td>{strings.iterations.kinds[it.kind]}</td>
      <td>{bareMeasured(it.delta_v_mm, it.delta_v_sigma_mm, unit, 4) ?? "—"}</td>
      <td>{bareMeasured(it.e_estimate_mm, it.e_estimate_sigma_mm, unit, 3) ?? "—"}</td>
      <td>{withSigma(it.spacing.spacing_px, it.spacing.spacing_sigma_px, 4)}</td>
      <td>{fixed(it.spacing_target_px, 4)}</td>
      <td>{readback(it.focus_mm)}</td>
      <td>{readback(it.e_mm)}</td>
      <td class="words">
        {it.discarded && <b>{strings.iterations.discarded} </b>}
        <span lang="en">{reworded(it.decision, unit)}</span>
      </td>
    </tr>
  );
}
