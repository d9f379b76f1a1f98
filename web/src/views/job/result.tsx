import { fixed, signed, withSigma } from "../../format";
import { strings } from "../../strings";
import type { Report } from "../../wire";

/** A position with its unit, or that it is unknown. */
function place(position: number | null | undefined): string {
  return typeof position === "number" ? `${fixed(position, 3)} mm` : strings.report.unknown;
}

function pixels(spacing: number | null | undefined): string {
  return typeof spacing === "number" ? `${fixed(spacing, 4)} px` : strings.report.unknown;
}

/** What an alignment came to. */
export function Result({ report }: { report: Report }) {
  const mm = (value: string | null) => (value === null ? strings.report.notMeasured : `${value} mm`);
  const end = (value: number | null | undefined, digits: number) =>
    value === null || value === undefined ? strings.report.infinity : `${fixed(value, digits)} mm`;
  const between = (interval: Report["depth_of_field"], digits: number, none: string) =>
    interval ? strings.report.fromTo(end(interval.low_mm, digits), end(interval.high_mm, digits)) : none;
  const against = (value: string, target: string) => `${value}, ${strings.report.targetOf(target)}`;
  const spacing = withSigma(report.spacing_px, report.spacing_sigma_px, 4);
  const rows: [string, string][] = [
    [
      strings.report.deltaV,
      against(
        mm(withSigma(report.delta_v_mm, report.delta_v_sigma_mm, 4)),
        `${fixed(report.delta_v_target_mm, 4)} mm`,
      ),
    ],
    [
      strings.report.e,
      against(mm(withSigma(report.e_mm, report.e_sigma_mm, 3)), `${fixed(report.e_target_mm, 3)} mm`),
    ],
    [
      strings.report.spacing,
      against(
        spacing === null ? strings.report.notMeasured : `${spacing} px`,
        `${fixed(report.spacing_target_px, 4)} px`,
      ),
    ],
    [
      strings.report.aperture,
      strings.report.ring(fixed(report.aperture_mm, 3), fixed(report.aperture_ring_f_number, 2)),
    ],
    [
      strings.report.fov,
      typeof report.fov_water_deg === "number"
        ? `${fixed(report.fov_water_deg, 2)}°`
        : strings.report.pastShell,
    ],
    [strings.report.depth, between(report.depth_of_field, 0, strings.report.notSharp)],
    [strings.report.tolerance, between(report.e_tolerance, 2, strings.report.noTolerance)],
    [
      strings.report.axes,
      strings.report.axesAt(place(report.focus_readback_mm), place(report.e_readback_mm)),
    ],
    [strings.report.moves, strings.report.movesOf(report.moves_air, report.moves_shell)],
    [
      strings.report.targets,
      strings.report.targetsOf(
        fixed(report.spacing_targets.paraxial_px, 4),
        pixels(report.spacing_targets.chief_ray_px),
        pixels(report.spacing_targets.window_px),
      ),
    ],
    [strings.report.step, report.shell_step_done],
    [strings.report.design, report.design_origin],
  ];
  const [x, y] = report.tilt_deg ?? [];
  if (typeof x === "number" && typeof y === "number") {
    rows.push([strings.report.tilt, strings.report.tiltOf(signed(x, 3), signed(y, 3))]);
  }
  if (typeof report.eog_before === "number" && typeof report.eog_after === "number") {
    rows.push([
      strings.report.eog,
      strings.report.change(fixed(report.eog_before, 1), fixed(report.eog_after, 1)),
    ]);
  }
  return (
    <section class="card result" aria-label={strings.report.title}>
      <h2>{strings.report.title}</h2>
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
    </section>
  );
}
