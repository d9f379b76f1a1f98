import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { strings } from "../../strings";
import { SPAN_S } from "../../trail";
import { inUnit, type LengthUnit } from "../../units";
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
    x: { ...scaleAxis(colours), values: (_plot, ticks) => ticks.map((tick) => strings.charts.ago(-tick)) },
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
      { label: strings.charts.target, stroke: colours.good, width: 2, dash: [6, 4], points: { show: false } },
      {
        label: strings.charts.spacing,
        stroke: colours.accent,
        width: 2,
        points: { size: 5, fill: colours.accent },
      },
    ],
    bands: [{ series: [2, 1], fill: colours.band }],
  };
}

function clarity(colours: Theme): Options {
  const { x, ...more } = base(colours);
  return {
    ...more,
    axes: [x, scaleAxis(colours, strings.charts.eog)],
    series: [
      {},
      {
        label: strings.charts.eog,
        stroke: colours.accent,
        width: 2,
        points: { show: true, size: 5, fill: colours.accent },
      },
    ],
  };
}

function axes(colours: Theme, unit: LengthUnit): Options {
  const { x, ...more } = base(colours);
  return {
    ...more,
    scales: { ...more.scales, focus: {}, e: {} },
    axes: [
      x,
      { ...scaleAxis(colours, strings.charts.focus(unit)), scale: "focus", stroke: colours.accent },
      {
        ...scaleAxis(colours, strings.charts.e(unit)),
        scale: "e",
        side: 1,
        grid: { show: false },
        stroke: colours.second,
      },
    ],
    series: [
      {},
      {
        label: strings.charts.focus(unit),
        scale: "focus",
        stroke: colours.accent,
        width: 2,
        points: { show: false },
      },
      {
        label: strings.charts.e(unit),
        scale: "e",
        stroke: colours.second,
        width: 2,
        dash: [10, 3],
        points: { show: false },
      },
    ],
  };
}

/** Spacing, clarity and axes over the last two minutes. */
export function Charts({ state, now }: Scene) {
  const { unit } = state.preferences;
  const second = Math.round(now / 500) / 2;
  const spacings = useMemo((): uPlot.AlignedData => {
    const { at, points } = state.spacings;
    const ago = at.map((time) => time - second);
    const spread = (sign: number) => points.map(({ spacingPx, sigmaPx }) => spacingPx + sign * 2 * sigmaPx);
    return [
      ago,
      spread(-1),
      spread(1),
      points.map(({ targetPx }) => targetPx),
      points.map(({ spacingPx }) => spacingPx),
    ];
  }, [state.spacings, second]);
  const clarities = useMemo(
    (): uPlot.AlignedData => [state.clarities.at.map((time) => time - second), state.clarities.points],
    [state.clarities, second],
  );
  const positions = useMemo((): uPlot.AlignedData => {
    const { at, points } = state.axes;
    const shown = (mm: number | null) => (mm === null ? null : inUnit(mm, unit));
    return [
      at.map((time) => time - second),
      points.map((point) => shown(point.focusMm)),
      points.map((point) => shown(point.eMm)),
    ];
  }, [state.axes, second, unit]);
  const words = strings.charts;
  return (
    <section class="card charts" aria-label={words.title}>
      <h2>{words.title}</h2>
      <div class="chart-row">
        <div>
          <p class="facts key">
            <LineKey of="accent">{words.spacing}</LineKey>
            <LineKey of="good">{words.targetAndBand}</LineKey>
          </p>
          <Plot label={words.spacing} height={HEIGHT} data={spacings} options={spacing} />
          {state.spacings.at.length === 0 && <p class="chart-none">{words.none}</p>}
        </div>
        <div>
          <p class="facts key" title={words.eogMore}>
            <LineKey of="accent">{words.eog}</LineKey>
          </p>
          <Plot label={words.eog} height={HEIGHT} data={clarities} options={clarity} />
          {state.clarities.points.every((eog) => eog === null) && <p class="chart-none">{words.none}</p>}
        </div>
        <div>
          <p class="facts key">
            <LineKey of="accent">{words.focus(unit)}</LineKey>
            <LineKey of="second">{words.e(unit)}</LineKey>
          </p>
          <Plot
            key={unit}
            label={words.axes(words.focus(unit), words.e(unit))}
            height={HEIGHT}
            data={positions}
            options={(colours) => axes(colours, unit)}
          />
        </div>
      </div>
    </section>
  );
}
