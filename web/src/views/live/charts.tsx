import { useMemo, useRef, useState } from "preact/hooks";
import type uPlot from "uplot";
import { broken } from "../../charts/gaps";
import { strings } from "../../strings";
import { allOf, stretchOf, type Looked } from "../../charts/stretch";
import { whole, type Trail } from "../../charts/trail";
import { inUnit, type LengthUnit } from "../../words/units";
import { LineKey } from "../line-key";
import { bandEdge, Plot, scaleAxis, type Options, type Theme } from "../plot";
import type { Given } from "../given";
import { Explained } from "../term";
import { Toggle } from "../toggle";
import { useChartGestures } from "./chart-gestures";
import { base, timeOfDay, type Shown } from "./time-axis";

const HEIGHT = 190;

/** What has not been read for longer is missing, s: whole measurements may be as far apart where no more are made. */
const LEAST_GAP_S = 3;
/** Of each stretch of the past two points are kept, which may be as far apart, in stretches. */
const PAST_GAP = 2.5;

function spacing(colours: Theme, shown: () => Shown): Options {
  const { x, ...more } = base(colours, shown);
  return {
    ...more,
    axes: [x, scaleAxis(colours, strings.charts.spacing)],
    series: [
      {},
      bandEdge,
      bandEdge,
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

function clarity(colours: Theme, shown: () => Shown): Options {
  const { x, ...more } = base(colours, shown);
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

/** An axis that stands still is not drawn as on a scale of many times its travel. */
const LEAST_SPAN_MM = 0.2;

function axes(colours: Theme, unit: LengthUnit, shown: () => Shown): Options {
  const { x, ...more } = base(colours, shown);
  const least = inUnit(LEAST_SPAN_MM, unit);
  const range = (_plot: uPlot, low: number | null, high: number | null): uPlot.Range.MinMax => {
    if (low === null || high === null) return [null, null];
    const beyond = Math.max(0.1 * (high - low), (least - (high - low)) / 2);
    return [low - beyond, high + beyond];
  };
  return {
    ...more,
    scales: { ...more.scales, focus: { range }, e: { range } },
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

/** Spacing, clarity and axes over the last two minutes, or whatever of the session is looked at. */
export function Charts({ state, now }: Given) {
  const { unit } = state.preferences;
  const [looked, look] = useState<Looked>("recent");
  const second = Math.round(now / 500) / 2;
  const trails = [state.spacings, state.clarities, state.axes];
  const oldest = Math.min(...trails.map(({ at, past }) => past.at[0] ?? at[0] ?? Infinity));
  const all = allOf(Number.isFinite(oldest) ? oldest : null, second);
  const { row, on, handles, step, share } = useChartGestures(looked, all, look);
  const stretch = stretchOf(looked, all);
  const day = useMemo(() => new Date().setHours(0, 0, 0, 0) / 1000, []);
  const shown = useRef<Shown>({ from: 0, to: 0, ago: true });
  shown.current = { from: stretch.from - day, to: stretch.to - day, ago: looked === "recent" };
  const about = [second, looked, unit, day];
  // What is not looked at is not drawn.
  const seen = <Point,>(trail: Trail<Point>) => {
    const { at, points } = looked === "recent" ? trail : whole(trail);
    const leastGapS = Math.max(LEAST_GAP_S, looked === "recent" ? 0 : PAST_GAP * trail.past.stepS);
    return { at: at.map((time) => time - day), points, leastGapS };
  };
  const spacings = useMemo((): uPlot.AlignedData => {
    const { at, points, leastGapS } = seen(state.spacings);
    const spread = (sign: number) => points.map(({ spacingPx, sigmaPx }) => spacingPx + sign * 2 * sigmaPx);
    const curves = [
      spread(-1),
      spread(1),
      points.map(({ targetPx }) => targetPx),
      points.map(({ spacingPx }) => spacingPx),
    ];
    return broken(at, curves, leastGapS);
  }, [state.spacings, ...about]);
  const clarities = useMemo((): uPlot.AlignedData => {
    const { at, points, leastGapS } = seen(state.clarities);
    return broken(at, [points], leastGapS);
  }, [state.clarities, ...about]);
  const positions = useMemo((): uPlot.AlignedData => {
    const { at, points } = seen(state.axes);
    const length = (mm: number | null) => (mm === null ? null : inUnit(mm, unit));
    return [at, points.map((point) => length(point.focusMm)), points.map((point) => length(point.eMm))];
  }, [state.axes, ...about]);
  const made = useMemo(() => {
    const now = () => shown.current;
    const of: Record<"spacing" | "clarity" | "axes", (colours: Theme) => Options> = {
      spacing: (colours) => spacing(colours, now),
      clarity: (colours) => clarity(colours, now),
      axes: (colours) => axes(colours, unit, now),
    };
    return of;
  }, [unit]);
  const words = strings.charts;
  const none = state.bench === null ? "" : looked === "recent" ? words.none : words.noneThen;
  /** Whether there is nothing of the last curve in what is looked at. */
  const empty = ([at, ...curves]: uPlot.AlignedData) => {
    const { from, to } = shown.current;
    const curve = curves.at(-1);
    return !at.some((time, index) => time >= from && time <= to && typeof curve?.[index] === "number");
  };
  return (
    <section class="card charts" aria-label={words.title}>
      <div class="row charts-head">
        <h2 id="charts-time">
          {looked === "recent"
            ? words.title
            : looked === "whole"
              ? words.wholeTitle
              : words.stretch(timeOfDay(stretch.from - day, 1), timeOfDay(stretch.to - day, 1))}
        </h2>
        <span class="choice" role="group" aria-label={words.time}>
          <button
            type="button"
            aria-label={words.earlier}
            title={words.earlier}
            onClick={() => handles.move(-share)}
          >
            ◀
          </button>
          <button
            type="button"
            aria-label={words.later}
            title={words.later}
            onClick={() => handles.move(share)}
          >
            ▶
          </button>
          <button
            type="button"
            aria-label={words.longer}
            title={words.longer}
            onClick={() => handles.zoom(step)}
          >
            −
          </button>
          <button
            type="button"
            aria-label={words.shorter}
            title={words.shorter}
            onClick={() => handles.zoom(1 / step)}
          >
            +
          </button>
          <Toggle on={looked === "whole"} set={() => look("whole")} title={words.wholeMore}>
            {words.whole}
          </Toggle>
          <Toggle on={looked === "recent"} set={() => look("recent")} title={words.recentMore}>
            {words.recent}
          </Toggle>
        </span>
      </div>
      <div
        ref={row}
        class="chart-row"
        tabIndex={0}
        role="group"
        aria-label={words.keys}
        data-looked={typeof looked === "string" ? looked : "stretch"}
        {...on}
      >
        <div>
          <p class="facts key">
            <LineKey of="accent">{words.spacingAndBand}</LineKey>
            <LineKey of="good">{words.target}</LineKey>
          </p>
          <Plot label={words.spacing} height={HEIGHT} data={spacings} options={made.spacing} />
          {empty(spacings) && <p class="chart-none">{none}</p>}
        </div>
        <div>
          <p class="facts key">
            <LineKey of="accent">
              <Explained text={words.eog} />
            </LineKey>
          </p>
          <Plot label={words.eog} height={HEIGHT} data={clarities} options={made.clarity} />
          {empty(clarities) && <p class="chart-none">{none}</p>}
        </div>
        <div>
          <p class="facts key">
            <LineKey of="accent">{words.focus(unit)}</LineKey>
            <LineKey of="second">
              <Explained text={words.e(unit)} />
            </LineKey>
          </p>
          <Plot
            key={unit}
            label={words.axes(words.focus(unit), words.e(unit))}
            height={HEIGHT}
            data={positions}
            options={made.axes}
          />
        </div>
      </div>
    </section>
  );
}
