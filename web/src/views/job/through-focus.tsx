import { useMemo } from "preact/hooks";
import type uPlot from "uplot";
import { strings } from "../../strings";
import { clarities, spacings } from "../../charts/through-focus";
import { inUnit, measuredLength, type LengthUnit } from "../../words/units";
import type { AxisName, FittedPlace, Job } from "../../daemon/wire";
import { LineKey } from "../line-key";
import { bandEdge, measuredLine, Plot, scaleAxis, type Options, type Theme } from "../plot";

const HEIGHT = 240;

/** Where best focus is by each of the two, in the chart's unit. */
interface Marks {
  spacing: number | null;
  eog: number | null;
}

/** Lines across the chart where best focus is. */
function marked({ spacing, eog }: Marks, colours: Theme): uPlot.Hooks.Arrays {
  const line = (plot: uPlot, at: number | null, colour: string) => {
    if (at === null) return;
    const x = Math.round(plot.valToPos(at, "x", true));
    const { top, height } = plot.bbox;
    plot.ctx.save();
    plot.ctx.strokeStyle = colour;
    plot.ctx.lineWidth = 2 * devicePixelRatio;
    plot.ctx.setLineDash([3 * devicePixelRatio, 3 * devicePixelRatio]);
    plot.ctx.beginPath();
    plot.ctx.moveTo(x, top);
    plot.ctx.lineTo(x, top + height);
    plot.ctx.stroke();
    plot.ctx.restore();
  };
  return {
    draw: [
      (plot) => {
        line(plot, spacing, colours.accent);
        line(plot, eog, colours.second);
      },
    ],
  };
}

const hidden = { ...bandEdge, spanGaps: true };

function spacingOptions(x: string, marks: Marks): (colours: Theme) => Options {
  const words = strings.throughFocus;
  return (colours) => ({
    scales: { x: { time: false } },
    legend: { show: false },
    axes: [scaleAxis(colours, x), scaleAxis(colours, words.spacing)],
    hooks: marked(marks, colours),
    series: [
      { label: x },
      hidden,
      hidden,
      { stroke: colours.good, width: 2, dash: [6, 4], points: { show: false }, spanGaps: true },
      { ...measuredLine(colours, words.spacing), width: 0 },
      { stroke: colours.accent, width: 2, points: { show: false }, spanGaps: true },
    ],
    bands: [{ series: [2, 1], fill: colours.band }],
  });
}

function eogOptions(x: string, marks: Marks): (colours: Theme) => Options {
  const { eog } = strings.charts;
  return (colours) => ({
    scales: { x: { time: false } },
    legend: { show: false },
    axes: [scaleAxis(colours, x), scaleAxis(colours, eog)],
    hooks: marked(marks, colours),
    series: [
      { label: x },
      {
        label: eog,
        stroke: colours.second,
        width: 0,
        points: { show: true, size: 7, fill: colours.second },
      },
      { stroke: colours.second, width: 2, points: { show: false }, spanGaps: true },
    ],
  });
}

interface Props {
  job: Job;
  axis: AxisName;
  unit: LengthUnit;
}

/** A sweep: spacing and EOG against the position, side by side, with best focus by each once it is known. */
export function ThroughFocus({ job, axis, unit }: Props) {
  const words = strings.throughFocus;
  const { iterations } = job;
  const found = job.outcome?.type === "focus_sweep" ? job.outcome : null;
  const best = found?.best_focus ?? null;
  const peak = found?.eog_peak ?? null;
  const spacing = useMemo(() => spacings(iterations, axis, best, unit), [iterations, axis, best, unit]);
  const eog = useMemo(() => clarities(iterations, axis, peak, unit), [iterations, axis, peak, unit]);
  const place = (at: FittedPlace | null) => at && inUnit(at.position_mm, unit);
  const marks = { spacing: place(best), eog: place(peak) };
  const x = axis === "focus" ? strings.charts.focus(unit) : strings.charts.e(unit);
  const told = (at: FittedPlace | null, none: string) =>
    measuredLength(at?.position_mm, at?.sigma_mm, unit, 4) ?? none;
  // Marks and unit are those of a chart's first showing.
  const key = [unit, marks.spacing, marks.eog].join(" ");
  return (
    <>
      {found && (
        <p class="facts key through-focus">
          <LineKey of="accent">{words.bestAt(told(best, words.noCrossing))}</LineKey>
          <LineKey of="second">{words.peakAt(told(peak, words.noPeak))}</LineKey>
          <LineKey of="good">{strings.iterations.chartTarget}</LineKey>
        </p>
      )}
      <div class="chart-row">
        <Plot
          key={`spacing ${key}`}
          label={words.spacingLabel}
          height={HEIGHT}
          data={spacing}
          options={spacingOptions(x, marks)}
        />
        <Plot
          key={`eog ${key}`}
          label={words.eogLabel}
          height={HEIGHT}
          data={eog}
          options={eogOptions(x, marks)}
        />
      </div>
    </>
  );
}
