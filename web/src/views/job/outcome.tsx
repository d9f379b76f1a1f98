import { fixed, withSigma } from "../../format";
import { strings } from "../../strings";
import type { Outcome as Found } from "../../wire";

const mm = (value: number | null | undefined, digits = 3) =>
  typeof value === "number" ? `${fixed(value, digits)} mm` : strings.report.unknown;

function rows(found: Found): [string, string][] {
  const words = strings.outcome;
  switch (found.type) {
    case "homing":
      return [
        [words.focus, mm(found.focus_mm)],
        [words.e, mm(found.e_mm)],
      ];
    case "calibration":
      return [
        [words.imageDistance, `${withSigma(found.image_distance_mm, found.image_distance_sigma_mm, 4)} mm`],
        [words.lensToMla, mm(found.lens_to_mla_mm, 4)],
        [words.b, mm(found.mla_to_sensor_mm, 4)],
        [words.deltaV, mm(found.delta_v_mm, 4)],
        [words.distances, found.distances_mm.map((distance) => fixed(distance, 1)).join(", ") + " mm"],
      ];
    case "l_bound":
      return [
        [words.lBound, `${withSigma(found.l_bound_mm, found.sigma_mm, 3)} mm`],
        [words.wall, mm(found.e_wall_mm)],
      ];
    case "focus_sweep":
      return [
        [words.axis, strings.axis.name[found.axis]],
        [
          words.crossing,
          typeof found.crossing_mm === "number"
            ? `${withSigma(found.crossing_mm, found.crossing_sigma_mm, 4)} mm`
            : words.noCrossing,
        ],
        [
          words.slope,
          typeof found.slope_px_per_mm === "number"
            ? `${fixed(found.slope_px_per_mm, 4)} px/mm`
            : strings.report.notMeasured,
        ],
        [words.measured, words.measuredOf(found.measured, found.positions)],
      ];
    case "spacing_watch":
      return [
        [words.mean, `${fixed(found.mean_px, 4)} px`],
        [words.scatter, `${fixed(found.scatter_px, 4)} px`],
        [words.between, strings.report.fromTo(fixed(found.least_px, 4), `${fixed(found.greatest_px, 4)} px`)],
        [words.drift, `${fixed(found.drift_px_per_h, 4)} px/h`],
        [words.measured, String(found.measured)],
      ];
  }
}

/** What a job that is no alignment came to. */
export function Outcome({ outcome }: { outcome: Found }) {
  return (
    <section class="card result" aria-label={strings.report.title}>
      <h2>{strings.report.title}</h2>
      <dl>
        {rows(outcome).map(([name, value]) => (
          <div key={name}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
    </section>
  );
}
