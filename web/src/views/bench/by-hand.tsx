import { useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { numberOf } from "../../words/number";
import { isLarge, type Pace } from "../../bench/pace";
import { able } from "../../state";
import { strings } from "../../strings";
import { nearWall, placeOf, sideBeyond } from "../../bench/travel";
import { length, signedLength, toMm } from "../../words/units";
import type { Axis } from "../../daemon/wire";
import { Ask } from "../ask";
import { useAsked } from "../asked";
import type { Given } from "../given";
import { onceHeld } from "../settled";
import { Hold } from "./hold";
import { LeaveSwitch } from "./leave-switch";

interface Props extends Given {
  axis: Axis;
  pace: Pace;
  /** Whether nobody may move it from here, be the daemon heard or not. */
  closed: boolean;
}

/** Jog, step, go to, home; off a limit switch where one is pressed. */
export function ByHand({ state, act, axis, pace, closed }: Props) {
  const { unit, stepMm } = state.preferences;
  const [text, setText] = useState("");
  const disabled = closed || !able(state, "control");
  const position = placeOf(axis);
  const name = strings.axis.short[axis.axis];
  const target = toMm(numberOf(text), unit);
  // What is only begun, a sign say, is no mistake yet.
  const unread = /[\d\p{L}]/u.test(text) && !Number.isFinite(target);
  const outside = Number.isFinite(target) && (target < axis.low_limit_mm || target > axis.high_limit_mm);
  const dead = disabled || position === null;
  const still = dead || axis.moving;
  const beyond = sideBeyond(axis);
  const untold = axis.axis === "e" && state.bench?.e_untold === true;
  const [asked, ask] = useAsked<number>(!still);

  const go = async (to: number) => {
    ask(null);
    if (await act(api.move(axis.axis, to))) setText("");
  };
  // What is dead only while it moves, or until another place is typed, keeps the focus: whoever steps by key goes on.
  const step = (by: number) => {
    const barred = still || beyond === (by < 0 ? "low" : "high");
    return (
      <button
        type="button"
        class="step"
        disabled={dead}
        aria-disabled={barred}
        aria-label={strings.byHand.stepBy(name, signedLength(by, unit))}
        onKeyDown={onceHeld}
        onClick={() => !barred && void act(api.move(axis.axis, position + by))}
      >
        {by < 0 ? "−" : "+"}
      </button>
    );
  };

  return (
    <>
      <form
        class="manual"
        onSubmit={(event) => {
          event.preventDefault();
          if (still || !Number.isFinite(target) || outside) return;
          if (isLarge(position, target)) ask(target);
          else void go(target);
        }}
      >
        <Hold
          axis={axis.axis}
          side="low"
          pace={pace}
          disabled={disabled || !axis.homed || beyond === "low"}
        />
        {step(-stepMm)}
        {step(stepMm)}
        <Hold
          axis={axis.axis}
          side="high"
          pace={pace}
          disabled={disabled || !axis.homed || beyond === "high"}
        />
        <input
          inputMode="decimal"
          value={text}
          aria-label={strings.byHand.moveTo(name, unit)}
          aria-invalid={outside || unread}
          placeholder={`${strings.byHand.to}, ${unit}`}
          // What is being typed outlasts a connection that comes and goes.
          disabled={closed || position === null}
          onInput={(event) => {
            setText(event.currentTarget.value);
            // It is of what stood there.
            ask(null);
          }}
        />
        <button type="submit" disabled={dead} aria-disabled={still || !Number.isFinite(target) || outside}>
          {strings.byHand.go}
        </button>
        <button
          type="button"
          class="home"
          disabled={disabled || !axis.connected}
          aria-disabled={axis.moving}
          aria-label={strings.byHand.homeMore(name)}
          onClick={() => !axis.moving && void act(api.home(axis.axis))}
        >
          {strings.byHand.home}
        </button>
      </form>
      {axis.connected && axis.limit_switch && (
        <LeaveSwitch act={act} axis={axis} disabled={disabled || axis.moving} />
      )}
      {unread && <p class="fault">{strings.form.noNumber}</p>}
      {outside && (
        <p class="fault">
          {strings.byHand.outside(length(axis.low_limit_mm, unit, 2), length(axis.high_limit_mm, unit, 2))}
        </p>
      )}
      {beyond !== null && <p class="fault">{strings.byHand.beyond[beyond](name)}</p>}
      {untold && (beyond === "low" || target < axis.low_limit_mm || nearWall(axis)) && (
        <p class="quiet untold">{strings.byHand.untold}</p>
      )}
      {asked !== null && position !== null && (
        <Ask
          key={asked}
          question={strings.byHand.sure(
            name,
            length(position, unit),
            length(asked, unit),
            signedLength(asked - position, unit),
          )}
          yes={strings.byHand.yes}
          no={strings.byHand.no}
          answer={(yes) => (yes ? void go(asked) : ask(null))}
        />
      )}
    </>
  );
}
