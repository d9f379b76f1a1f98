import { fixed } from "../../words/format";
import { strings } from "../../strings";
import {
  angle,
  length,
  measuredLength,
  measuredPixels,
  pixels,
  reworded,
  signedAngle,
  type LengthUnit,
} from "../../words/units";
import type { Report } from "../../daemon/wire";
import { BudgetTable } from "./budget";
import { Rows } from "./rows";

/** The report's figures in words. */
export function figures(report: Report, unit: LengthUnit): [string, string, "en"?][] {
  const words = strings.report;
  const at = (mm: number | null | undefined) =>
    typeof mm === "number" ? length(mm, unit, 3) : words.unknown;
  const spacing = (px: number | null | undefined) => (typeof px === "number" ? pixels(px, 4) : words.unknown);
  const end = (mm: number | null | undefined, digits: number) =>
    typeof mm === "number" ? length(mm, unit, digits) : words.infinity;
  // What follows from Δv and e is not told without both.
  const isReached = typeof report.delta_v_mm === "number" && typeof report.e_mm === "number";
  const without = (none: string) => (isReached ? none : words.notMeasured);
  const between = (interval: Report["depth_of_field"], digits: number, none: string) =>
    interval ? words.fromTo(end(interval.low_mm, digits), end(interval.high_mm, digits)) : without(none);
  const against = (value: string | null, target: string) =>
    `${value ?? words.notMeasured}, ${words.targetOf(target)}`;
  const rows: [string, string, "en"?][] = [
    [
      words.deltaV,
      against(
        measuredLength(report.delta_v_mm, report.delta_v_sigma_mm, unit, 4),
        length(report.delta_v_target_mm, unit, 4),
      ),
    ],
    [
      words.e,
      against(measuredLength(report.e_mm, report.e_sigma_mm, unit, 3), length(report.e_target_mm, unit, 3)),
    ],
    [
      words.spacing,
      against(
        measuredPixels(report.spacing_px, report.spacing_sigma_px, 4),
        pixels(report.spacing_target_px, 4),
      ),
    ],
    [
      words.aperture,
      words.ring(length(report.aperture_mm, unit, 3), fixed(report.aperture_ring_f_number, 2)),
    ],
    [
      words.fov,
      typeof report.fov_water_deg === "number" ? angle(report.fov_water_deg, 2) : without(words.pastShell),
    ],
    [words.depth, between(report.depth_of_field, 0, words.notSharp)],
    [words.tolerance, between(report.e_tolerance, 2, words.noTolerance)],
    [words.axes, words.axesAt(at(report.focus_readback_mm), at(report.e_readback_mm))],
    [words.moves, words.movesOf(report.moves_air, report.moves_shell)],
    [
      words.targets,
      words.targetsOf(
        pixels(report.spacing_targets.paraxial_px, 4),
        spacing(report.spacing_targets.chief_ray_px),
        spacing(report.spacing_targets.window_px),
      ),
    ],
    [words.step, reworded(report.shell_step_done, unit), "en"],
    [words.design, report.design_origin, "en"],
  ];
  const [x, y] = report.tilt_deg ?? [];
  if (typeof x === "number" && typeof y === "number") {
    const sigma = typeof report.tilt_sigma_deg === "number" ? angle(report.tilt_sigma_deg, 3) : null;
    rows.push([words.tilt, words.tiltOf(signedAngle(x, 3), signedAngle(y, 3), sigma)]);
  }
  if (typeof report.eog_before === "number" && typeof report.eog_after === "number") {
    rows.push([words.eog, words.change(fixed(report.eog_before, 1), fixed(report.eog_after, 1))]);
  }
  const spent = report.time_spent;
  if (spent) {
    const names = Object.entries(words.timeParts) as [keyof typeof words.timeParts, string][];
    const parts = names.map(([part, name]) => `${name} ${words.seconds(fixed(spent[part], 1))}`);
    rows.push([words.time, words.timeOf(words.seconds(fixed(spent.total_s, 1)), parts)]);
  }
  return rows;
}

/** What an alignment came to. */
export function Result({ report, unit }: { report: Report; unit: LengthUnit }) {
  return (
    <section class="card result" aria-label={strings.report.title}>
      <h2>{strings.report.title}</h2>
      {report.budget && <BudgetTable budget={report.budget} unit={unit} />}
      <Rows of={figures(report, unit)} />
      {report.notes.map((note) => (
        <p key={note} class="quiet" lang="en">
          {reworded(note, unit)}
        </p>
      ))}
    </section>
  );
}
