import { useMemo } from "preact/hooks";
import uPlot from "uplot";
import { strings } from "../../strings";
import { inUnit, type LengthUnit } from "../../words/units";
import type { Draft } from "../../daemon/wire";
import { LineKey } from "../line-key";
import { Plot, scaleAxis, tickText, type Options, type Theme } from "../plot";
import type { Other } from "./figures";

const HEIGHT = 210;
/** What a number along the distance takes, and a place beside it. */
const TICK_PX = 84;
/** Half as wide as a digit, px. */
const HALF_DIGIT_PX = 3.6;
/** Of the blur still sharp: more need not be told apart. */
const BLUR_SHOWN = 8;

type Points = (number | null)[];

/** Curves on one abscissa; a place that only another one has is no gap. */
function joined(tables: [number[], ...Points[]][]): uPlot.AlignedData {
  return uPlot.join(tables as uPlot.AlignedData[]);
}

interface Props {
  draft: Draft;
  other: Other | null;
  unit: LengthUnit;
}

/** Δv and field of view over e, blur over the distance. */
export function Curves({ draft, other, unit }: Props) {
  const words = strings.design;
  const shown = (values: (number | null | undefined)[]): Points =>
    values.map((value) => (typeof value === "number" ? inUnit(value, unit) : null));
  const drafts = other ? [draft, other.draft] : [draft];
  const marked = (from: Draft, of: "delta_v_mm" | "fov_deg"): [number[], Points] => {
    const states = from.states.filter(({ state }) => state === "clarity" || state === "joint");
    const sorted = [...states].sort((one, next) => (one.e_mm ?? 0) - (next.e_mm ?? 0));
    const values = sorted.map((state) => state[of] ?? null);
    return [
      sorted.map((state) => inUnit(state.e_mm ?? 0, unit)),
      of === "delta_v_mm" ? shown(values) : values,
    ];
  };
  const overE = (of: "delta_v_mm" | "fov_deg") =>
    joined(
      drafts.flatMap((from): [number[], Points][] => {
        const values = from.over_e[of].map((value) => value ?? null);
        const curve = of === "delta_v_mm" ? shown(values) : values;
        return [[from.over_e.e_mm.map((e) => inUnit(e, unit)), curve], marked(from, of)];
      }),
    );
  const [deltaV, fov, blur] = useMemo(() => {
    const limit = draft.design.blur_limit_px;
    const over = drafts.map(({ over_distance: curve }): [number[], ...Points[]] => [
      curve.distance_mm.map((distance) => inUnit(distance, unit)),
      ...(["clarity_px", "joint_px"] as const).map((of) => curve[of].map((value) => value ?? null)),
    ]);
    const first = over[0]?.[0] ?? [];
    over.push([first, first.map(() => limit)]);
    return [overE("delta_v_mm"), overE("fov_deg"), joined(over)];
  }, [draft, other?.draft, unit]);
  const both = other !== null;
  // Round the object distance: what the curve has in its middle.
  const { distance_mm: places } = draft.over_distance;
  const about = [0, 0.25, 0.5, 0.75, 1].map((share) =>
    Number(inUnit(places[Math.round(share * (places.length - 1))] ?? 0, unit).toPrecision(4)),
  );
  const key = `${unit} ${both} ${draft.design.blur_limit_px}`;
  const along = words.overE(unit);
  const distances = words.overDistance(unit);
  return (
    <section class="card curves" aria-label={words.curves}>
      <h2>{words.curves}</h2>
      <div class="curve-grid">
        <div>
          <Key both={both} other={other} first={words.curveDeltaV(unit)} />
          <Plot
            key={key}
            label={words.curveLabel(words.curveDeltaV(unit), along)}
            height={HEIGHT}
            data={deltaV}
            options={(theme) => lines(theme, along, words.curveDeltaV(unit), both)}
          />
        </div>
        <div>
          <Key both={both} other={other} first={words.curveFov} />
          <Plot
            key={key}
            label={words.curveLabel(words.curveFov, along)}
            height={HEIGHT}
            data={fov}
            options={(theme) => lines(theme, along, words.curveFov, both)}
          />
        </div>
        <div>
          <p class="facts key">
            <LineKey of="accent">{words.state.joint}</LineKey>
            <LineKey of="second">{words.state.clarity}</LineKey>
            <LineKey of="good">{words.limit}</LineKey>
            {other && <span>{words.thin(other.name)}</span>}
          </p>
          <Plot
            key={`${key} ${about.join()}`}
            label={words.curveLabel(words.curveBlur, distances)}
            height={HEIGHT}
            data={blur}
            options={(theme) => blurs(theme, distances, both, draft.design.blur_limit_px, about)}
          />
        </div>
      </div>
    </section>
  );
}

function Key({ both, other, first }: { both: boolean; other: Other | null; first: string }) {
  return (
    <p class="facts key">
      <LineKey of="accent">
        {first} ● {strings.design.solutions}
      </LineKey>
      {both && other && <LineKey of="second">{other.name}</LineKey>}
    </p>
  );
}

function base(colours: Theme, along: string, up: string): Omit<Options, "series"> {
  return {
    legend: { show: false },
    cursor: { show: true },
    axes: [{ ...scaleAxis(colours, along), size: 48 * colours.scale }, scaleAxis(colours, up)],
  };
}

function lines(colours: Theme, along: string, up: string, both: boolean): Options {
  const curve = (label: string, colour: string, dash?: number[]): uPlot.Series => ({
    label,
    stroke: colour,
    width: 2,
    points: { show: false },
    ...(dash ? { dash } : {}),
  });
  const dots = (colour: string): uPlot.Series => ({
    stroke: "transparent",
    points: { show: true, size: 9, fill: colour, stroke: colour },
  });
  return {
    ...base(colours, along, up),
    scales: { x: { time: false } },
    series: [
      { label: along },
      curve(up, colours.accent),
      dots(colours.accent),
      ...(both ? [curve(strings.design.theOther, colours.second, [10, 4]), dots(colours.second)] : []),
    ],
  };
}

function blurs(colours: Theme, along: string, both: boolean, limit: number, about: number[]): Options {
  const curve = (colour: string, width: number, dash?: number[], label?: string): uPlot.Series => ({
    stroke: colour,
    width,
    ...(label === undefined ? {} : { label }),
    points: { show: false },
    ...(dash ? { dash } : {}),
  });
  const { clarity, joint } = strings.design.state;
  const pair = (width: number, named: boolean) => [
    curve(colours.second, width, [10, 4], named ? clarity : undefined),
    curve(colours.accent, width, undefined, named ? joint : undefined),
  ];
  const { axes, ...rest } = base(colours, along, strings.design.curveBlur);
  const [x = {}, up = {}] = axes ?? [];
  const last = tickText(about.at(-1) ?? null);
  return {
    ...rest,
    // Half of the last number stands beyond the end of the scale.
    padding: [null, Math.ceil(last.length * HALF_DIGIT_PX * colours.scale), null, null],
    axes: [
      {
        ...x,
        // On a narrow chart long numbers would run into one another.
        splits: (plot) =>
          plot.width < TICK_PX * about.length ? about.filter((_, at) => at % 2 === 0) : about,
        filter: (_plot, splits) => splits,
        values: (_plot, splits) => splits.map(tickText),
      },
      up,
    ],
    scales: {
      x: { time: false, distr: 3, log: 10, range: [about[0] ?? 1, about.at(-1) ?? 10] },
      y: { range: (_plot, _least, most) => [0, Math.min(Math.max(most, 2 * limit), BLUR_SHOWN * limit)] },
    },
    series: [
      { label: along },
      ...pair(2, true),
      ...(both ? pair(1, false) : []),
      curve(colours.good, 2, [6, 4]),
    ],
  };
}
