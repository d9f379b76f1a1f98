import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { strings } from "../../strings";
import type { Job } from "../../wire";
import { LineKey } from "../line-key";
import { Plot, scaleAxis, type Options, type Theme } from "../plot";

const HEIGHT = 240;

function options(colours: Theme): Options {
  return {
    scales: { x: { time: false } },
    legend: { show: false },
    cursor: { show: true },
    axes: [
      { ...scaleAxis(colours), incrs: [1, 2, 5, 10, 20, 50, 100] },
      scaleAxis(colours, strings.iterations.chartSpacing),
    ],
    series: [
      {},
      { stroke: "transparent", points: { show: false } },
      { stroke: "transparent", points: { show: false } },
      { stroke: colours.good, width: 2, dash: [6, 4], points: { show: false } },
      { stroke: colours.accent, width: 2, points: { show: true, size: 7, fill: colours.accent } },
    ],
    bands: [{ series: [2, 1], fill: colours.band }],
  };
}

/** Spacing and target, iteration by iteration. */
export function Convergence({ job }: { job: Job }) {
  const data = useMemo((): uPlot.AlignedData => {
    const all = job.iterations;
    const twice = (sign: number) =>
      all.map((it) => it.spacing.spacing_px + sign * 2 * it.spacing.spacing_sigma_px);
    return [
      all.map((it) => it.number),
      twice(-1),
      twice(1),
      all.map((it) => it.spacing_target_px),
      all.map((it) => it.spacing.spacing_px),
    ];
  }, [job.iterations]);
  return (
    <>
      <p class="facts key">
        <LineKey of="accent">{strings.iterations.chartSpacing}</LineKey>
        <LineKey of="good">{strings.iterations.chartTarget}</LineKey>
      </p>
      <Plot label={strings.iterations.chartSpacing} height={HEIGHT} data={data} options={options} />
    </>
  );
}
