import * as api from "../../daemon/api";
import { strings } from "../../strings";
import type { Axis, Side } from "../../daemon/wire";
import { Ask } from "../ask";
import { useAsked } from "../asked";
import type { Given } from "../given";

const ENDS: readonly Side[] = ["low", "high"];

interface Props extends Pick<Given, "act"> {
  axis: Axis;
  disabled: boolean;
}

/** Moves an axis off its limit switch, once the operator has said which of the two it stands on. */
export function LeaveSwitch({ act, axis, disabled }: Props) {
  const [asking, ask] = useAsked<true>(!disabled);
  const name = strings.axis.short[axis.axis];
  if (asking) {
    return (
      <Ask
        question={strings.byHand.leaveSure(name)}
        yes={ENDS.map((end) => strings.byHand.leaveFrom[end])}
        no={strings.byHand.leaveNot}
        answer={(yes, way) => {
          ask(null);
          const pressed = ENDS[way];
          if (yes && pressed) void act(api.leaveSwitch(axis.axis, pressed));
        }}
      />
    );
  }
  return (
    <p class="actions">
      <button
        type="button"
        class="leave-switch"
        disabled={disabled}
        aria-label={strings.byHand.leaveMore(name)}
        onClick={() => ask(true)}
      >
        {strings.byHand.leave}
      </button>
    </p>
  );
}
