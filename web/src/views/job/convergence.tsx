import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { strings } from "../../strings";
import type { Job } from "../../daemon/wire";
import { differenceAxis, differenceScale } from "../difference";
import { LineKey } from "../line-key";
import { bandEdge, measuredLine, Plot, scaleAxis, type Options, type Theme } from "../plot";

const HEIGHT = 240;

function options(colours: Theme): Options {
  return {
    scales: { x: { time: false }, y: differenceScale },
    legend: { show: false },
    cursor: { show: true },
    axes: [
      {
        ...scaleAxis(colours, strings.charts.iteration),
        size: 48 * colours.scale,
        incrs: [1, 2, 5, 10, 20, 50, 100],
      },
      differenceAxis(colours, strings.iterations.chartDifference),
    ],
    series: [
      { label: strings.charts.iteration },
      bandEdge,
      bandEdge,
      { stroke: colours.good, width: 2, dash: [6, 4], points: { show: false } },
      measuredLine(colours, strings.iterations.chartDifference),
    ],
    bands: [{ series: [2, 1], fill: colours.band }],
  };
}

/** The spacing less its target, iteration by iteration, of those that count. */
export function Convergence({ job }: { job: Job }) {
  const data = useMemo((): uPlot.AlignedData => {
    const all = job.iterations.filter((it) => !it.discarded);
    const apart = (sigmas: number) =>
      all.map(
        ({ spacing, spacing_target_px: target }) =>
          spacing.spacing_px - target + sigmas * spacing.spacing_sigma_px,
      );
    return [all.map((it) => it.number), apart(-2), apart(2), all.map(() => 0), apart(0)];
  }, [job.iterations, job.steps]);
  return (
    <>
      <p class="facts key">
        <LineKey of="accent">{strings.iterations.chartBand}</LineKey>
        <LineKey of="good">{strings.iterations.chartTarget}</LineKey>
      </p>
      <Plot label={strings.iterations.chartDifference} height={HEIGHT} data={data} options={options} />
    </>
  );
}
