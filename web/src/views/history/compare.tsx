import { moment } from "../../words/format";
import { useEffect, useMemo, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { comparison } from "../../charts/comparison";
import { addressOf } from "../../browser/route";
import { strings } from "../../strings";
import type { Job } from "../../daemon/wire";
import { differenceAxis, differenceScale } from "../difference";
import { Plot, scaleAxis, type Options, type Theme } from "../plot";
import type { Given } from "../given";

const HEIGHT = 300;

function options(colours: Theme): Options {
  const dots = (colour: string) => ({ show: true, size: 7, fill: colour });
  return {
    scales: { x: { time: false }, y: differenceScale },
    legend: { show: false },
    cursor: { show: true },
    axes: [
      {
        ...scaleAxis(colours, strings.charts.iteration),
        size: 48 * colours.scale,
        incrs: [1, 2, 5, 10, 20, 50, 100],
      },
      differenceAxis(colours, strings.history.difference),
    ],
    series: [
      { label: strings.charts.iteration },
      {
        label: strings.history.first,
        stroke: colours.accent,
        width: 2,
        points: dots(colours.accent),
        spanGaps: true,
      },
      {
        label: strings.history.second,
        stroke: colours.second,
        width: 2,
        dash: [10, 4],
        points: dots(colours.second),
        spanGaps: true,
      },
    ],
  };
}

/** Runs chosen, against one another. */
export function Compare({ ids, load, state }: Given & { ids: string[] }) {
  const connected = state.link === "open";
  const [kept, setKept] = useState<Record<string, Job>>({});
  useEffect(() => {
    for (const id of connected ? ids.filter((id) => !kept[id]) : []) {
      void load(
        api.job(id).then((result) => {
          if (result.ok) setKept((before) => ({ ...before, [id]: result.value }));
          return result;
        }),
      );
    }
  }, [ids.join(), connected]);
  // One that is under way goes on.
  const runs = ids
    .map((id) => state.jobs.find((job) => job.id === id) ?? kept[id])
    .filter((run) => run !== undefined);
  const data = useMemo(
    () => comparison(runs),
    [runs.map(({ id, iterations }) => `${id} ${iterations.length}`).join()],
  );
  if (runs.length === 0) return null;
  return (
    <section class="card compare" aria-label={strings.history.compareTitle(runs.length)}>
      <h2>
        {strings.history.compareTitle(runs.length)}
        <a href={addressOf("history")}>{strings.history.clear}</a>
      </h2>
      <ul class="key">
        {runs.map((run, index) => (
          <li key={run.id} class="facts">
            <span class={index === 0 ? "line accent" : "line second"} /> {moment(run.created_at)} ·{" "}
            {strings.job.kinds[run.kind]} · {strings.job.state[run.state]} ·{" "}
            {strings.history.iterationsOf(run.iterations.length)}
          </li>
        ))}
      </ul>
      <Plot
        key={runs.map((run) => run.id).join()}
        label={strings.history.difference}
        height={HEIGHT}
        data={data}
        options={(colours) => {
          const made = options(colours);
          return { ...made, series: made.series.slice(0, runs.length + 1) };
        }}
      />
    </section>
  );
}
