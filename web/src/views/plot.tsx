import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";

/** Colours of the page's theme, for what CSS does not reach. */
export interface Theme {
  ink: string;
  line: string;
  accent: string;
  second: string;
  good: string;
  band: string;
}

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

/** A chart. Its options are those of its first showing; its data is kept up with. */
export function Plot({ label, height, data, options }: Props) {
  const holder = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const newest = useRef(data);
  newest.current = data;

  useEffect(() => {
    const element = holder.current;
    if (!element) return;
    const make = () => {
      plot.current?.destroy();
      const size = { width: element.clientWidth, height };
      plot.current = new uPlot({ ...options(theme(element)), ...size }, newest.current, element);
    };
    make();
    const resize = new ResizeObserver(() => plot.current?.setSize({ width: element.clientWidth, height }));
    resize.observe(element);
    // Other colours, and on paper another width besides.
    const media = [matchMedia("(prefers-color-scheme: dark)"), matchMedia("print")];
    for (const one of media) one.addEventListener("change", make);
    return () => {
      for (const one of media) one.removeEventListener("change", make);
      resize.disconnect();
      plot.current?.destroy();
      plot.current = null;
    };
  }, []);

  useEffect(() => plot.current?.setData(data), [data]);
  return <div ref={holder} class="chart" role="img" aria-label={label} />;
}

/** A tick's number as the page spells numbers: no separators, which are read as decimal points by half of the world. */
export function tickText(tick: number | null): string {
  return tick === null ? "" : String(Number(tick.toPrecision(10))).replace("-", "−");
}

/** An axis of a chart in the page's colours. */
export function scaleAxis(colours: Theme, label?: string): uPlot.Axis {
  return {
    stroke: colours.ink,
    values: (_plot, ticks) => ticks.map(tickText),
    grid: { stroke: colours.line, width: 1 },
    ticks: { stroke: colours.line, width: 1 },
    ...(label === undefined ? {} : { label, labelSize: 18, size: 62, labelFont: "12px system-ui" }),
  };
}
