import { useState } from "preact/hooks";
import * as api from "../api";
import { fixed } from "../format";
import { along, axisScale, type State } from "../state";
import { strings } from "../strings";
import type { Axis, Bench, ShellState } from "../wire";
import type { Act } from "./app";

export function Axes({ state, act }: { state: State; act: Act }) {
  const bench = state.bench;
  if (!bench) return null;
  const busy = bench.job !== null && bench.job !== undefined;
  return (
    <section class="card axes">
      {bench.axes.map((axis) => (
        <AxisRow key={axis.axis} bench={bench} axis={axis} />
      ))}
      <Lease bench={bench} act={act} />
      <details>
        <summary>{strings.byHand}</summary>
        {bench.axes.map((axis) => (
          <Manual key={axis.axis} axis={axis} disabled={busy || bench.stop.latched} act={act} />
        ))}
        <Shell bench={bench} disabled={busy} act={act} />
      </details>
    </section>
  );
}

/** Who may move the axes. */
function Lease({ bench, act }: { bench: Bench; act: Act }) {
  const lease = bench.lease ?? null;
  const mine = api.lease.isMine(lease);
  return (
    <p class="facts lease" data-lease={lease === null ? "free" : mine ? "mine" : "others"}>
      <span>
        {lease === null
          ? strings.leaseFree
          : mine
            ? strings.leaseMine
            : strings.leaseHeld(lease.owner, lease.note)}
      </span>
      {lease === null && (
        <button type="button" onClick={() => void act(api.takeLease())}>
          {strings.leaseTake}
        </button>
      )}
      {mine && (
        <button type="button" onClick={() => void act(api.releaseLease())}>
          {strings.leaseRelease}
        </button>
      )}
    </p>
  );
}

function AxisRow({ bench, axis }: { bench: Bench; axis: Axis }) {
  const scale = axisScale(bench, axis);
  const percent = (position: number) => `${(100 * along(scale, position)).toFixed(2)}%`;
  const position = axis.homed ? axis.position_mm : null;
  return (
    <div class="axis" data-axis={axis.axis}>
      <h2>
        {strings.axis[axis.axis]}
        <span class="readback" title={strings.readbackMore}>
          {strings.readback}
        </span>
        <span class="value">
          {position === null || position === undefined ? "—" : `${fixed(position, 3)} mm`}
        </span>
      </h2>
      <div class="scale">
        {scale.wall !== null && <i class="forbidden" style={{ width: percent(scale.wall) }} />}
        <i class="limit" style={{ left: percent(axis.low_limit_mm) }} />
        <i class="limit" style={{ left: percent(axis.high_limit_mm) }} />
        {scale.wall !== null && (
          <i class="wall" style={{ left: percent(scale.wall) }}>
            <span>
              {strings.wall} {fixed(scale.wall, 2)}
            </span>
          </i>
        )}
        {position !== null && position !== undefined && (
          <i class="marker" style={{ left: percent(position) }} />
        )}
      </div>
      <p class="facts ends">
        <span>{scale.wall === null ? fixed(axis.low_limit_mm, 1) : ""}</span>
        <span>{fixed(axis.high_limit_mm, 1)} mm</span>
      </p>
      <p class="facts tags">
        {!axis.connected && <span class="tag bad">{strings.disconnected}</span>}
        {axis.connected && !axis.homed && !axis.fault && <span class="tag bad">{strings.notHomed}</span>}
        {axis.moving && <span class="tag">{strings.moving}</span>}
        {axis.fault && <span class="tag bad">{axis.fault}</span>}
        {axis.failure && axis.failure !== axis.fault && <span class="tag bad">{axis.failure}</span>}
        {axis.disagreements.map((text) => (
          <span key={text} class="tag bad">
            {text}
          </span>
        ))}
      </p>
    </div>
  );
}

function Manual({ axis, disabled, act }: { axis: Axis; disabled: boolean; act: Act }) {
  const [text, setText] = useState("");
  const target = Number(text);
  const usable = text.trim() !== "" && Number.isFinite(target);
  return (
    <form
      class="manual"
      onSubmit={(event) => {
        event.preventDefault();
        if (usable) void act(api.move(axis.axis, target));
      }}
    >
      <label>
        {strings.axis[axis.axis]}
        <input
          inputMode="decimal"
          value={text}
          aria-label={strings.moveTo(axis.axis)}
          placeholder={
            axis.position_mm === null || axis.position_mm === undefined ? "mm" : axis.position_mm.toFixed(3)
          }
          onInput={(event) => setText(event.currentTarget.value)}
        />
      </label>
      <button type="submit" disabled={disabled || !usable || !axis.homed}>
        {strings.move}
      </button>
      <button type="button" disabled={disabled} onClick={() => void act(api.home(axis.axis))}>
        {strings.home}
      </button>
    </form>
  );
}

function Shell({ bench, disabled, act }: { bench: Bench; disabled: boolean; act: Act }) {
  const choose = (state: ShellState) => {
    // "Off" opens the way for the e axis: on the operator's word only.
    if (state !== "off" || window.confirm(strings.shellSure)) void act(api.setShell(state));
  };
  return (
    <div class="manual" role="group" aria-label={strings.shell}>
      <span>{strings.shell}</span>
      {(["on", "off", "unknown"] as const).map((state) => (
        <button
          key={state}
          type="button"
          disabled={disabled}
          aria-pressed={bench.shell === state}
          onClick={() => choose(state)}
        >
          {strings.shellState[state]}
        </button>
      ))}
    </div>
  );
}
