import { useEffect } from "preact/hooks";
import { jog, useJog } from "../../bench/jogging";
import { SPEED_MM_PER_S, type Pace } from "../../bench/pace";
import { strings } from "../../strings";
import type { AxisName, Side } from "../../daemon/wire";

interface Props {
  axis: AxisName;
  side: Side;
  pace: Pace;
  disabled: boolean;
}

/** A button that moves an axis for as long as it is held: with finger, mouse, or Enter. */
export function Hold({ axis, side, pace, disabled }: Props) {
  const pressed = useJog();
  const held = pressed?.axis === axis && pressed.towards === side;
  const begin = () => {
    if (!disabled) jog.begin({ axis, towards: side, speedMmPerS: SPEED_MM_PER_S[pace] });
  };
  // Only of its own press: that of another button, which takes the focus from this one, goes on.
  const letGo = () => {
    if (jog.pressed?.axis === axis && jog.pressed.towards === side) jog.release();
  };
  // A button that goes away, or that may not be pressed any more, is let go of.
  useEffect(() => letGo, []);
  useEffect(() => {
    if (disabled && held) jog.release();
  }, [disabled, held]);
  return (
    <button
      type="button"
      class="hold"
      data-axis={axis}
      data-side={side}
      data-held={held}
      disabled={disabled}
      title={strings.byHand.hold[side]}
      aria-label={strings.byHand.holdOf(strings.axis.short[axis], strings.byHand.hold[side])}
      onPointerDown={(event) => {
        if (event.button !== 0) return;
        event.currentTarget.setPointerCapture(event.pointerId);
        begin();
      }}
      onPointerUp={letGo}
      onPointerCancel={letGo}
      onLostPointerCapture={letGo}
      onContextMenu={(event) => event.preventDefault()}
      onKeyDown={(event) => {
        if (event.key !== "Enter") return;
        event.preventDefault();
        if (!event.repeat) begin();
      }}
      onKeyUp={(event) => event.key === "Enter" && letGo()}
      onBlur={letGo}
    >
      {side === "low" ? "◀" : "▶"}
    </button>
  );
}
