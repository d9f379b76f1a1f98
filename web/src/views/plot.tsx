import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { spoken } from "../words/language";

/** Colours of the page's theme, for what CSS does not reach. */
export interface Theme {
  ink: string;
  line: string;
  accent: string;
  second: string;
  good: string;
  band: string;
  /** How many times as large as usual the page's letters are. */
  scale: number;
}

const FAMILY = "system-ui";
/** The page's letters as they usually are, px. */
const LETTER_PX = 15;

function theme(element: Element): Theme {
  const style = getComputedStyle(element);
  const of = (name: string) => style.getPropertyValue(name).trim();
  return {
    ink: of("--quiet"),
    line: of("--line"),
    accent: of("--accent"),
    second: of("--second"),
    good: of("--good"),
    band: of("--band"),
    scale: parseFloat(getComputedStyle(document.documentElement).fontSize) / LETTER_PX,
  };
}

export type Options = Omit<uPlot.Options, "width" | "height">;

interface Props {
  /** What it shows, for who cannot see it. */
  label: string;
  height: number;
  data: uPlot.AlignedData;
  options: (theme: Theme) => Options;
}

/** A chart. Its options are those of its first showing in a language; its data is kept up with. */
export function Plot({ label, height, data, options }: Props) {
  const holder = useRef<HTMLDivElement>(null);
  const read = useRef<HTMLParagraphElement>(null);
  const plot = useRef<uPlot | null>(null);
  const newest = useRef(data);
  newest.current = data;

  useEffect(() => {
    const element = holder.current;
    if (!element) return;
    const make = () => {
      plot.current?.destroy();
      const colours = theme(element);
      const size = { width: element.clientWidth, height: Math.round(height * colours.scale) };
      const asked = options(colours);
      const names = asked.series.map(({ label }) => label);
      // Straight onto the page: the pointer moves faster than the page is drawn.
      const say = (plot: uPlot) => {
        if (read.current) read.current.textContent = readOff(plot, names);
      };
      const hooks = { ...asked.hooks, setCursor: [say] };
      plot.current = new uPlot({ ...asked, ...size, hooks }, newest.current, element);
    };
    make();
    const resize = new ResizeObserver(() => {
      const now = plot.current;
      if (now) now.setSize({ width: element.clientWidth, height: now.height });
    });
    resize.observe(element);
    // Other colours, larger letters, and on paper another width besides.
    const media = ["(prefers-color-scheme: dark)", "(min-width: 2200px)", "print"].map((one) =>
      matchMedia(one),
    );
    for (const one of media) one.addEventListener("change", make);
    return () => {
      for (const one of media) one.removeEventListener("change", make);
      resize.disconnect();
      plot.current?.destroy();
      plot.current = null;
    };
  }, [spoken.language]);

  useEffect(() => plot.current?.setData(data), [data]);
  return (
    <div class="charted">
      <div ref={holder} class="chart" role="img" aria-label={label} />
      <p ref={read} class="read-off" aria-hidden="true" />
    </div>
  );
}

/** Significant digits of what is read off a curve. */
const READ_DIGITS = 6;

/** Nothing that is drawn is as small as this. */
const READ_PLACES = 9;

/** What the curves that have names are under the pointer; nothing where it is not over them. */
export function readOff(
  { cursor, data }: Pick<uPlot, "cursor" | "data">,
  names: uPlot.Series["label"][],
): string {
  const at = cursor.idx;
  if (typeof at !== "number") return "";
  return names
    .flatMap((name, index) => {
      const value = data[index]?.[at];
      if (typeof name !== "string" || typeof value !== "number") return [];
      const rounded = Number(Number(value.toPrecision(READ_DIGITS)).toFixed(READ_PLACES));
      return `${name} ${tickText(rounded)}`;
    })
    .join(" · ");
}

/** A tick's number as the page spells numbers: no separators, which are read as decimal points by half of the world. */
export function tickText(tick: number | null): string {
  return tick === null ? "" : String(Number(tick.toPrecision(10))).replace("-", "−");
}

/** An edge of the band about what is measured: not drawn itself. */
export const bandEdge: uPlot.Series = { stroke: "transparent", points: { show: false } };

/** What is measured, a line through its points. */
export function measuredLine(colours: Theme, label: string): uPlot.Series {
  return {
    label,
    stroke: colours.accent,
    width: 2,
    points: { show: true, size: 7, fill: colours.accent },
  };
}

/** An axis of a chart in the page's colours. */
export function scaleAxis(colours: Theme, label?: string): uPlot.Axis {
  const px = (usual: number) => Math.round(usual * colours.scale);
  const font = [`${px(12)}px`, FAMILY].join(" ");
  return {
    stroke: colours.ink,
    font,
    size: px(50),
    values: (_plot, ticks) => ticks.map(tickText),
    grid: { stroke: colours.line, width: 1 },
    ticks: { stroke: colours.line, width: 1 },
    ...(label === undefined ? {} : { label, labelSize: px(18), size: px(62), labelFont: font }),
  };
}
