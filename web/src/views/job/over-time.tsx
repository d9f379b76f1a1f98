import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { strings } from "../../strings";
import type { Job } from "../../wire";
import { LineKey } from "../line-key";
import { bandEdge, measuredLine, Plot, scaleAxis, type Options, type Theme } from "../plot";

const HEIGHT = 240;
const MINUTE_MS = 60_000;

function options(colours: Theme): Options {
  const words = strings.iterations;
  return {
    scales: { x: { time: false } },
    legend: { show: false },
    cursor: { show: true },
    axes: [scaleAxis(colours, words.minutes), scaleAxis(colours, words.spacing)],
    series: [{ label: words.minutes }, bandEdge, bandEdge, measuredLine(colours, words.spacing)],
    bands: [{ series: [2, 1], fill: colours.band }],
  };
}

/** A watch: the spacing over time, as large as it changes. */
export function OverTime({ job }: { job: Job }) {
  const data = useMemo((): uPlot.AlignedData => {
    const all = job.iterations;
    const begun = Date.parse(all[0]?.at ?? "");
    const apart = (sigmas: number) =>
      all.map(({ spacing }) => spacing.spacing_px + sigmas * spacing.spacing_sigma_px);
    return [all.map(({ at }) => (Date.parse(at) - begun) / MINUTE_MS), apart(-2), apart(2), apart(0)];
  }, [job.iterations]);
  return (
    <>
      <p class="facts key">
        <LineKey of="accent">{strings.iterations.spacingBand}</LineKey>
      </p>
      <Plot label={strings.iterations.spacing} height={HEIGHT} data={data} options={options} />
    </>
  );
}
