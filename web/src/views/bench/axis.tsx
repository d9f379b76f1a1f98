import { strings } from "../../strings";
import { along, axisScale, placeOf } from "../../bench/travel";
import { length, reworded, type LengthUnit } from "../../words/units";
import type { Axis, Bench } from "../../daemon/wire";
import { Explained } from "../term";

interface Props {
  bench: Bench;
  axis: Axis;
  unit: LengthUnit;
}

/** Where an axis stands, its limits and the wall. */
export function AxisScale({ bench, axis, unit }: Props) {
  const scale = axisScale(bench, axis);
  const percent = (position: number) => `${(100 * along(scale, position)).toFixed(2)}%`;
  const position = placeOf(axis);
  const at = position === null ? strings.axis.unknown : length(position, unit);
  const name = strings.axis.name[axis.axis];
  const [low, high] = [length(axis.low_limit_mm, unit, 2), length(axis.high_limit_mm, unit, 2)];
  return (
    <>
      <h3>
        <span>
          <Explained text={name} />
        </span>
        <span class="tags">
          {!axis.connected && <span class="tag bad">{strings.axis.disconnected}</span>}
          {axis.connected && !axis.homed && <span class="tag bad">{strings.axis.notHomed}</span>}
          {axis.limit_switch && <span class="tag bad">{strings.byHand.onSwitch}</span>}
          {axis.moving && <span class="tag">{strings.axis.moving}</span>}
        </span>
        <span class="value" title={strings.axis.readbackMore}>
          {position === null ? "—" : at}
        </span>
      </h3>
      <div class="scale" role="img" aria-label={strings.axis.scale(name, at, low, high)}>
        {scale.wall !== null && <i class="forbidden" style={{ width: percent(scale.wall) }} />}
        <i class="limit" style={{ left: percent(axis.low_limit_mm) }} />
        <i class="limit" style={{ left: percent(axis.high_limit_mm) }} />
        {scale.wall !== null && <i class="wall" style={{ left: percent(scale.wall) }} />}
        {position !== null && <i class="marker" style={{ left: percent(position) }} />}
      </div>
      <p class="ends">
        {scale.wall === null ? (
          <span>{low}</span>
        ) : (
          <span class="wall-name">
            {strings.axis.wall} {length(scale.wall, unit, 2)}
          </span>
        )}
        <span>{high}</span>
      </p>
      {[axis.fault, axis.failure === axis.fault ? null : axis.failure, ...axis.disagreements].map(
        (text) =>
          text && (
            <p key={text} class="tag bad" lang="en">
              {reworded(text, unit)}
            </p>
          ),
      )}
    </>
  );
}
