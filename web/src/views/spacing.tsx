import { fixed, signed } from "../format";
import { measurementAge, OLD_MEASUREMENT_MS, reading, type State } from "../state";
import { strings } from "../strings";

const ARROW = { larger: "▲", smaller: "▼", there: "●" } as const;

export function Spacing({ state, now: clock }: { state: State; now: number }) {
  const now = reading(state.measurement);
  const age = measurementAge(state, clock);
  const old = age !== null && age > OLD_MEASUREMENT_MS;
  return (
    <section class="card spacing" data-old={old} aria-label={strings.spacing}>
      <h2>{strings.spacing}</h2>
      {now ? (
        <>
          <p class="large" data-direction={now.direction}>
            <span class="number" id="spacing">
              {fixed(now.spacingPx, 4)}
            </span>
            <span class="sigma"> ± {fixed(now.sigmaPx, 4)} px</span>
          </p>
          <p class="against">
            {strings.target} <b>{fixed(now.targetPx, 4)} px</b>{" "}
            <span class="difference" data-direction={now.direction}>
              {ARROW[now.direction]} {signed(now.differencePx, 4)} px
            </span>
          </p>
          <p class="facts">
            <span>{strings.direction[now.direction]}</span>
            <span class={now.inFocus ? "tag good" : "tag"}>
              {now.inFocus ? strings.inFocus : strings.outOfFocus}
            </span>
            {old && <span class="tag">{strings.measuredAgo(fixed(age / 1000, 0))}</span>}
          </p>
        </>
      ) : (
        <p class="quiet">{strings.spacingNone}</p>
      )}
    </section>
  );
}
