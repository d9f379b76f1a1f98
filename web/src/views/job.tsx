import * as api from "../api";
import { fixed, withSigma } from "../format";
import { currentJob, isFinal, type State } from "../state";
import { strings } from "../strings";
import type { Iteration, Job, Report } from "../wire";
import type { Act } from "./app";
import { Chart } from "./chart";

export function JobCard({ state, act }: { state: State; act: Act }) {
  const job = currentJob(state);
  const over = !job || isFinal(job.state);
  const stopped = state.bench?.stop.latched ?? false;
  return (
    <section class="card job" aria-label={strings.job} data-state={job?.state ?? "none"}>
      <h2>
        {strings.job}
        {job && <span class={`outcome ${job.state}`}>{strings.jobState[job.state]}</span>}
      </h2>
      {!job && <p class="quiet">{strings.jobNone}</p>}
      {job && !over && <Progress job={job} />}
      {job && <OperatorStep job={job} act={act} />}
      {job && over && job.reason && <p class="reason">{job.reason}</p>}
      <p class="actions">
        {over ? (
          <button
            id="start"
            class="primary"
            disabled={stopped || !state.bench}
            onClick={() => void act(api.startAlignment())}
          >
            {job ? strings.startAgain : strings.start}
          </button>
        ) : (
          <button
            id="cancel"
            disabled={job.state === "cancelling"}
            onClick={() => void act(api.cancelJob(job))}
          >
            {strings.cancel}
          </button>
        )}
      </p>
      {job?.report && <Result report={job.report} />}
    </section>
  );
}

export function Iterations({ state }: { state: State }) {
  const job = currentJob(state);
  if (!job || (job.iterations.length === 0 && job.log.length === 0)) return null;
  return (
    <section class="card iterations" aria-label={strings.iterations}>
      <h2>{strings.iterations}</h2>
      {job.iterations.length > 0 ? <Table job={job} /> : <p class="quiet">{strings.spacingNone}</p>}
      <details>
        <summary>{strings.log}</summary>
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
      <Chart key={job.id} iterations={job.iterations} />
      <div class="table">
        <table>
          <thead>
            <tr>
              {Object.values(strings.columns).map((name) => (
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

/** A position with its unit, or that it is unknown. */
function place(position: number | null | undefined): string {
  return typeof position === "number" ? `${fixed(position, 3)} mm` : strings.unknown;
}

function pixels(spacing: number | null | undefined): string {
  return typeof spacing === "number" ? `${fixed(spacing, 4)} px` : strings.unknown;
}

/** A readback in mm. */
function readback(position: number | null | undefined): string {
  return position === null || position === undefined ? "—" : fixed(position, 3);
}

function Row({ it }: { it: Iteration }) {
  return (
    <tr>
      <td>{it.number}</td>
      <td>{strings.stages[it.stage]}</td>
      <td>{strings.kinds[it.kind]}</td>
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

function Progress({ job }: { job: Job }) {
  return (
    <div class="progress">
      <progress value={job.progress.step} max={Math.max(1, job.progress.of)} />
      <p>{job.progress.doing}</p>
    </div>
  );
}

function OperatorStep({ job, act }: { job: Job; act: Act }) {
  const step = job.operator_step;
  if (!step || job.state !== "waiting_for_operator") return null;
  return (
    <div class="operator">
      <h3>{strings.operator(step.number)}</h3>
      {step.value && <p class="number">{step.value}</p>}
      <p>{step.instruction}</p>
      <button id="confirm" class="primary" onClick={() => void act(api.confirmStep(job, step.number))}>
        {strings.confirm}
      </button>
    </div>
  );
}

function Result({ report }: { report: Report }) {
  const mm = (value: string | null) => (value === null ? strings.notMeasured : `${value} mm`);
  const end = (value: number | null | undefined, digits: number) =>
    value === null || value === undefined ? strings.infinity : `${fixed(value, digits)} mm`;
  const between = (interval: Report["depth_of_field"], digits: number, none: string) =>
    interval ? strings.fromTo(end(interval.low_mm, digits), end(interval.high_mm, digits)) : none;
  const against = (value: string, target: string) => `${value}, ${strings.targetOf(target)}`;
  const spacing = withSigma(report.spacing_px, report.spacing_sigma_px, 4);
  const rows: [string, string][] = [
    [
      strings.rows.deltaV,
      against(
        mm(withSigma(report.delta_v_mm, report.delta_v_sigma_mm, 4)),
        `${fixed(report.delta_v_target_mm, 4)} mm`,
      ),
    ],
    [
      strings.rows.e,
      against(mm(withSigma(report.e_mm, report.e_sigma_mm, 3)), `${fixed(report.e_target_mm, 3)} mm`),
    ],
    [
      strings.rows.spacing,
      against(
        spacing === null ? strings.notMeasured : `${spacing} px`,
        `${fixed(report.spacing_target_px, 4)} px`,
      ),
    ],
    [
      strings.rows.aperture,
      strings.ring(fixed(report.aperture_mm, 3), fixed(report.aperture_ring_f_number, 2)),
    ],
    [
      strings.rows.fov,
      typeof report.fov_water_deg === "number" ? `${fixed(report.fov_water_deg, 2)}°` : strings.pastShell,
    ],
    [strings.rows.depth, between(report.depth_of_field, 0, strings.notSharp)],
    [strings.rows.tolerance, between(report.e_tolerance, 2, strings.noTolerance)],
    [strings.rows.axes, strings.axesAt(place(report.focus_readback_mm), place(report.e_readback_mm))],
    [strings.rows.moves, strings.movesOf(report.moves_air, report.moves_shell)],
    [
      strings.rows.targets,
      strings.targets(
        fixed(report.spacing_targets.paraxial_px, 4),
        pixels(report.spacing_targets.chief_ray_px),
        pixels(report.spacing_targets.window_px),
      ),
    ],
    [strings.rows.step, report.shell_step_done],
    [strings.rows.design, report.design_origin],
  ];
  if (typeof report.eog_before === "number" && typeof report.eog_after === "number") {
    rows.push([strings.rows.eog, strings.change(fixed(report.eog_before, 1), fixed(report.eog_after, 1))]);
  }
  return (
    <div class="result">
      <dl>
        {rows.map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {report.notes.map((note) => (
        <p key={note} class="quiet">
          {note}
        </p>
      ))}
    </div>
  );
}
