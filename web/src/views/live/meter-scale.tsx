import { fixed } from "../../words/format";
import { band, beyond, END_PX, MARKS_PX, place } from "../../meter/scale";
import type { Best, Reading } from "../../meter/reading";
import { strings } from "../../strings";

interface Props {
  /** Null where there is none now. */
  reading: Reading | null;
  best: Best | null;
  /** |difference| still called sharp, px. */
  blurPx: number | null;
  /** |difference| that a job accepts, px. */
  tolerancePx: number;
}

const percent = (place: number) => `${(50 + 50 * place).toFixed(2)}%`;

/** The meter's scale: the target in the middle, what is sharp about it, the reading with its uncertainty. */
export function MeterScale({ reading, best, blurPx, tolerancePx }: Props) {
  const sharp = blurPx === null ? null : place(blurPx);
  const accepted = place(tolerancePx);
  return (
    <div class="meter-scale" aria-hidden="true">
      <div class="track">
        {sharp !== null && (
          <i class="sharp" style={{ left: percent(-sharp), width: `${(100 * sharp).toFixed(2)}%` }} />
        )}
        <i class="accepted" style={{ left: percent(-accepted), width: `${(100 * accepted).toFixed(2)}%` }} />
        {MARKS_PX.map((mark) => (
          <i key={mark} class="mark" style={{ left: percent(place(mark)) }} />
        ))}
        <i class="target" />
        {best && <i class="best" style={{ left: percent(place(best.differencePx)) }} />}
        {reading && <Pointer {...reading} />}
      </div>
      <p class="marks">
        <span class="end">▼ {strings.meter.ends.smaller}</span>
        {MARKS_PX.filter((mark) => Math.abs(mark) < END_PX).map((mark) => (
          <span key={mark} style={{ left: percent(place(mark)) }}>
            {fixed(mark, Number.isInteger(mark) ? 0 : 1)}
          </span>
        ))}
        <span class="end">{strings.meter.ends.larger} ▲</span>
      </p>
    </div>
  );
}

function Pointer({ differencePx, sigmaPx }: Reading) {
  const { from, to } = band(differencePx, sigmaPx);
  return (
    <>
      <i class="band" style={{ left: percent(from), width: `${(50 * (to - from)).toFixed(2)}%` }} />
      <i class="pointer" data-beyond={beyond(differencePx)} style={{ left: percent(place(differencePx)) }} />
    </>
  );
}
