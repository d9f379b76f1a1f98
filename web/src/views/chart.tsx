import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { strings } from "../strings";
import type { Iteration } from "../wire";

const HEIGHT = 220;

/** Columns for the chart: iteration number, spacing, target. */
function columns(iterations: Iteration[]): uPlot.AlignedData {
  return [
    iterations.map((it) => it.number),
    iterations.map((it) => it.spacing.spacing_px),
    iterations.map((it) => it.spacing_target_px),
  ];
}

export function Chart({ iterations }: { iterations: Iteration[] }) {
  const holder = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);

  useEffect(() => {
    const element = holder.current;
    if (!element) return;
    const style = getComputedStyle(element);
    const ink = style.getPropertyValue("--quiet").trim();
    const axis = { stroke: ink, grid: { stroke: style.getPropertyValue("--line").trim() } };
    const made = new uPlot(
      {
        width: element.clientWidth,
        height: HEIGHT,
        cursor: { show: true },
        legend: { show: false },
        scales: { x: { time: false } },
        axes: [
          { ...axis, incrs: [1, 2, 5, 10] },
          { ...axis, size: 56, label: strings.chartSpacing, labelSize: 18, stroke: ink },
        ],
        series: [
          {},
          {
            label: strings.chartSpacing,
            stroke: style.getPropertyValue("--accent").trim(),
            width: 2,
            points: { show: true, size: 7 },
          },
          {
            label: strings.chartTarget,
            stroke: style.getPropertyValue("--good").trim(),
            width: 2,
            dash: [6, 4],
            points: { show: false },
          },
        ],
      },
      columns(iterations),
      element,
    );
    plot.current = made;
    const resize = new ResizeObserver(() => made.setSize({ width: element.clientWidth, height: HEIGHT }));
    resize.observe(element);
    return () => {
      resize.disconnect();
      made.destroy();
      plot.current = null;
    };
  }, []);

  useEffect(() => plot.current?.setData(columns(iterations)), [iterations.length]);
  return <div ref={holder} class="chart" />;
}
