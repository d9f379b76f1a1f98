import { strings } from "../../strings";
import {
  length,
  lengths,
  measuredLength,
  pixels,
  pixelsAnHour,
  pixelsPer,
  type LengthUnit,
} from "../../words/units";
import type { FittedPlace, Outcome as Found } from "../../daemon/wire";
import { Rows } from "./rows";

function rows(found: Found, unit: LengthUnit): [string, string][] {
  const words = strings.outcome;
  const at = (mm: number | null | undefined, digits = 3) =>
    typeof mm === "number" ? length(mm, unit, digits) : strings.report.unknown;
  const measured = (mm: number | null | undefined, sigmaMm: number | null | undefined, digits: number) =>
    measuredLength(mm, sigmaMm, unit, digits) ?? strings.report.unknown;
  const { throughFocus } = strings;
  const best = (of: FittedPlace | null | undefined, none: string) =>
    measuredLength(of?.position_mm, of?.sigma_mm, unit, 4) ?? none;
  switch (found.type) {
    case "homing":
      return [
        [words.focus, at(found.focus_mm)],
        [words.e, at(found.e_mm)],
      ];
    case "calibration":
      return [
        [words.imageDistance, measured(found.image_distance_mm, found.image_distance_sigma_mm, 4)],
        [words.lensToMla, at(found.lens_to_mla_mm, 4)],
        [words.b, at(found.mla_to_sensor_mm, 4)],
        // It is the image distance less what the design has.
        [words.deltaV, measured(found.delta_v_mm, found.image_distance_sigma_mm, 4)],
        [words.distances, lengths(found.distances_mm, unit, 1)],
      ];
    case "l_bound":
      return [
        [words.lBound, measured(found.l_bound_mm, found.sigma_mm, 4)],
        [words.wall, at(found.e_wall_mm)],
      ];
    case "focus_sweep":
      return [
        [words.axis, strings.axis.name[found.axis]],
        // One best focus: the curve's, or where no curve could be fitted that between the two positions about it.
        found.best_focus == null && typeof found.crossing_mm === "number"
          ? [words.crossing, measured(found.crossing_mm, found.crossing_sigma_mm, 4)]
          : [throughFocus.best, best(found.best_focus, throughFocus.noCrossing)],
        [throughFocus.peak, best(found.eog_peak, throughFocus.noPeak)],
        [
          words.slope,
          typeof found.slope_px_per_mm === "number"
            ? pixelsPer(found.slope_px_per_mm, unit, 4)
            : strings.report.notMeasured,
        ],
        [words.measured, words.measuredOf(found.measured, found.positions)],
      ];
    case "spacing_watch":
      return [
        [words.mean, pixels(found.mean_px, 4)],
        [words.scatter, pixels(found.scatter_px, 4)],
        [words.between, strings.report.fromTo(pixels(found.least_px, 4), pixels(found.greatest_px, 4))],
        [words.drift, pixelsAnHour(found.drift_px_per_h, found.drift_sigma_px_per_h, 4)],
        [words.measured, words.measuredOfTimes(found.measured, found.measured + (found.unmeasured ?? 0))],
      ];
  }
}

/** What a job that is no alignment came to. */
export function Outcome({ outcome, unit }: { outcome: Found; unit: LengthUnit }) {
  return (
    <section class="card result" aria-label={strings.report.title}>
      <h2>{strings.report.title}</h2>
      <Rows of={rows(outcome, unit)} />
    </section>
  );
}
