import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { broken } from "../../charts/gaps";
import { strings } from "../../strings";
import type { Job } from "../../daemon/wire";
import { LineKey } from "../line-key";
import { bandEdge, measuredLine, Plot, scaleAxis, type Options, type Theme } from "../plot";

const HEIGHT = 240;
const UNIT_MS = { seconds: 1000, minutes: 60_000 } as const;
/** So long is said in minutes, ms. */
const MINUTES_MS = 180_000;

function options(unit: keyof typeof UNIT_MS, colours: Theme): Options {
  const words = strings.iterations;
  return {
    scales: { x: { time: false } },
    legend: { show: false },
    cursor: { show: true },
    axes: [scaleAxis(colours, words.since[unit]), scaleAxis(colours, words.spacing)],
    series: [{ label: words.since[unit] }, bandEdge, bandEdge, measuredLine(colours, words.spacing)],
    bands: [{ series: [2, 1], fill: colours.band }],
  };
}

/** A watch: the spacing over time, as large as it changes; no line where a frame could not be measured. */
export function OverTime({ job }: { job: Job }) {
  const sinceMs = (at = "") => Date.parse(at) - Date.parse(job.iterations[0]?.at ?? "");
  const unit = sinceMs(job.iterations.at(-1)?.at) < MINUTES_MS ? "seconds" : "minutes";
  const data = useMemo((): uPlot.AlignedData => {
    const all = job.iterations;
    const apart = (sigmas: number) =>
      all.map(({ spacing }) => spacing.spacing_px + sigmas * spacing.spacing_sigma_px);
    return broken(
      all.map(({ at }) => sinceMs(at) / UNIT_MS[unit]),
      [apart(-2), apart(2), apart(0)],
    );
  }, [job.iterations, unit]);
  return (
    <>
      <p class="facts key">
        <LineKey of="accent">{strings.iterations.spacingBand}</LineKey>
      </p>
      <Plot
        key={unit}
        label={strings.iterations.spacing}
        height={HEIGHT}
        data={data}
        options={(colours) => options(unit, colours)}
      />
    </>
  );
}
