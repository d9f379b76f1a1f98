import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { strings } from "../../strings";
import { SPAN_S } from "../../trail";
import { LineKey } from "../line-key";
import { Plot, scaleAxis, type Options, type Theme } from "../plot";
import type { Scene } from "../scene";

const HEIGHT = 190;

/** Seconds before now, from the left. */
function base(colours: Theme): Pick<Options, "scales" | "legend" | "cursor"> & { x: uPlot.Axis } {
  return {
    scales: { x: { time: false, range: [-SPAN_S, 0] } },
    legend: { show: false },
    cursor: { show: true },
    x: { ...scaleAxis(colours), values: (_plot, ticks) => ticks.map((tick) => `${-tick} s`) },
  };
}

function spacing(colours: Theme): Options {
  const { x, ...more } = base(colours);
  return {
    ...more,
    axes: [x, scaleAxis(colours, strings.charts.spacing)],
    series: [
      {},
      { stroke: "transparent", points: { show: false } },
      { stroke: "transparent", points: { show: false } },
      { stroke: colours.good, width: 2, dash: [6, 4], points: { show: false } },
      { stroke: colours.accent, width: 2, points: { show: true, size: 5, fill: colours.accent } },
    ],
    bands: [{ series: [2, 1], fill: colours.band }],
  };
}

function axes(colours: Theme): Options {
  const { x, ...more } = base(colours);
  return {
    ...more,
    scales: { ...more.scales, focus: {}, e: {} },
    axes: [
      x,
      { ...scaleAxis(colours, strings.charts.focus), scale: "focus", stroke: colours.accent },
      {
        ...scaleAxis(colours, strings.charts.e),
        scale: "e",
        side: 1,
        grid: { show: false },
        stroke: colours.second,
      },
    ],
    series: [
      {},
      { scale: "focus", stroke: colours.accent, width: 2, points: { show: false } },
      { scale: "e", stroke: colours.second, width: 2, dash: [10, 3], points: { show: false } },
    ],
  };
}

/** Spacing and axes over the last two minutes. */
export function Charts({ state, now }: Scene) {
  const second = Math.round(now / 500) / 2;
  const spacings = useMemo((): uPlot.AlignedData => {
    const { at, points } = state.spacings;
    return [
      at.map((time) => time - second),
      points.map((point) => point.spacingPx - 2 * point.sigmaPx),
      points.map((point) => point.spacingPx + 2 * point.sigmaPx),
      points.map((point) => point.targetPx),
      points.map((point) => point.spacingPx),
    ];
  }, [state.spacings, second]);
  const positions = useMemo((): uPlot.AlignedData => {
    const { at, points } = state.axes;
    return [
      at.map((time) => time - second),
      points.map((point) => point.focusMm),
      points.map((point) => point.eMm),
    ];
  }, [state.axes, second]);
  const legend = `${strings.charts.target}, ${strings.charts.band}`;
  return (
    <section class="card charts" aria-label={strings.charts.title}>
      <h2>{strings.charts.title}</h2>
      <div class="chart-pair">
        <div>
          <p class="facts key">
            <LineKey of="accent">{strings.charts.spacing}</LineKey>
            <LineKey of="good">{legend}</LineKey>
          </p>
          <Plot label={strings.charts.spacing} height={HEIGHT} data={spacings} options={spacing} />
          {state.spacings.at.length === 0 && <p class="chart-none">{strings.charts.none}</p>}
        </div>
        <div>
          <p class="facts key">
            <LineKey of="accent">{strings.charts.focus}</LineKey>
            <LineKey of="second">{strings.charts.e}</LineKey>
          </p>
          <Plot
            label={`${strings.charts.focus}, ${strings.charts.e}`}
            height={HEIGHT}
            data={positions}
            options={axes}
          />
        </div>
      </div>
    </section>
  );
}
