import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { fixed } from "../../words/format";
import { numberOf } from "../../words/number";
import { another } from "../../words/names";
import { may, type State } from "../../state";
import { strings } from "../../strings";
import type { AutoExposure, Light, LightControl } from "../../daemon/wire";
import { Old } from "../old";
import type { Given } from "../given";
import { HistogramView } from "./histogram";

/** How the camera is set, as of the newest time that this may have changed; null before it has said so. */
function useLight(state: State): [Light | null, (light: Light) => void] {
  const [light, keep] = useState<Light | null>(null);
  const { bench, link } = state;
  const online = link === "open" && bench?.camera.online === true;
  useEffect(() => {
    if (!online) return undefined;
    let asked = true;
    void api.light().then((answer) => asked && keep(answer.ok ? answer.value : null));
    return () => {
      asked = false;
    };
    // Whoever sets it, what stands before the lens counts as set up anew.
  }, [online, bench?.set_up_at, bench?.job]);
  return [light, keep];
}

/** Why nothing can be set from here, be the daemon heard or not; null where it can. */
function barred(state: State): string | null {
  const { bench } = state;
  const words = strings.camera.reason;
  if (!bench) return words.link;
  if (!may(state, "control")) return strings.viewOnly;
  if (!bench.camera.online) return words.gone;
  const other = api.lease.other(bench.lease);
  if (bench.job) return words.job;
  return other === null ? null : words.others(another(other, "first"));
}

/** The camera's exposure and gain, and how the newest frame is exposed. */
export function CameraPanel(given: Given) {
  const { state, act } = given;
  const [light, keep] = useLight(state);
  const [found, tell] = useState<AutoExposure | null>(null);
  const [searching, search] = useState(false);
  // What is typed into a field is no more than that once another value was found for it.
  const [searches, count] = useState(0);
  const closed = barred(state);
  const why = state.link === "open" ? closed : strings.camera.reason.link;
  const controls = light?.controls ?? [];
  const settable = controls.some(({ locked }) => locked == null);

  const set = async (control: LightControl, value: number) => {
    tell(null);
    const answer = api.setLight(control.name, value);
    if (!(await act(answer))) return false;
    const done = await answer;
    if (done.ok) keep(done.value);
    return true;
  };
  const auto = async () => {
    tell(null);
    search(true);
    const answer = api.autoExpose();
    if (await act(answer)) {
      const done = await answer;
      if (done.ok) {
        keep(done.value);
        tell(done.value);
        count(searches + 1);
      }
    }
    search(false);
  };

  return (
    <section class="card camera" aria-label={strings.camera.title}>
      <h2>
        {strings.camera.title}
        <Old {...given} />
      </h2>
      {controls.map((control) => (
        <Control
          key={`${control.name} ${searches}`}
          control={control}
          closed={closed !== null}
          disabled={why !== null}
          busy={searching}
          set={set}
        />
      ))}
      {light && controls.length === 0 && <p class="quiet">{strings.camera.none}</p>}
      {controls.length > 0 && (
        <p class="auto-exposure">
          <button
            type="button"
            id="auto-exposure"
            disabled={why !== null || !settable}
            // Whoever pressed it is still there when it has ended.
            aria-disabled={searching}
            title={strings.camera.autoMore}
            onClick={() => !searching && void auto()}
          >
            {searching ? strings.camera.searching : strings.camera.auto}
          </button>
          <span class="quiet" role="status">
            {found && (found.changed ? "" : `${strings.camera.leftAsItWas} `)}
            {found &&
              strings.camera.found(
                fixed(100 * found.bright_level, 0),
                fixed(100 * found.clipped_share, 2),
                found.frames,
              )}
          </span>
        </p>
      )}
      {why !== null && (controls.length > 0 || light === null) && (
        <p class="quiet" id="camera-barred">
          {why}
        </p>
      )}
      {why === null && light?.white_frame && settable && <p class="quiet">{strings.camera.dropsWhite}</p>}
      <HistogramView {...given} />
    </section>
  );
}

interface ControlProps {
  control: LightControl;
  /** Whether nothing may be typed: what is outlasts a connection that comes and goes. */
  closed: boolean;
  disabled: boolean;
  /** Whether the exposure is being searched for. */
  busy: boolean;
  set: (control: LightControl, value: number) => Promise<boolean>;
}

/** As many digits as tell one step from the next. */
function said(value: number, { step }: LightControl): string {
  return fixed(value, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)));
}

/** A number with its limits, which is set by Enter, or by the button behind it. */
function Control({ control, closed, disabled, busy, set }: ControlProps) {
  const now = control.value == null ? "" : said(control.value, control);
  const [typed, type] = useState<string | null>(null);
  const name = strings.camera.name[control.name];
  const unit = strings.camera.unit[control.unit];
  const limits = strings.camera.limits(said(control.minimum, control), said(control.maximum, control), unit);
  const text = typed ?? now;
  const value = numberOf(text);
  const outside = Number.isFinite(value) && (value < control.minimum || value > control.maximum);
  const wrong = typed !== null && (outside || !Number.isFinite(value));
  const locked = control.locked ?? null;
  const barred = busy || typed === null || wrong;
  const submit = async () => {
    if (!barred && (await set(control, value))) type(null);
  };
  return (
    <form
      class="control"
      data-control={control.name}
      onSubmit={(event) => {
        event.preventDefault();
        void submit();
      }}
    >
      <label>
        <span>{name}</span>
        <input
          inputMode="decimal"
          value={text}
          aria-label={strings.camera.field(name, unit)}
          aria-invalid={wrong}
          aria-describedby={`${control.name}-limits`}
          disabled={closed || locked !== null}
          onInput={(event) => type(event.currentTarget.value)}
        />
        <span>{unit}</span>
      </label>
      <button
        type="submit"
        aria-label={strings.camera.setMore(name)}
        disabled={disabled || locked !== null}
        aria-disabled={barred}
      >
        {strings.camera.set}
      </button>
      <span class="quiet limits" id={`${control.name}-limits`}>
        {limits}
        {control.unit === "driver" && `, ${strings.camera.driverUnit}`}
      </span>
      {wrong && <p class="fault">{outside ? strings.camera.outside(limits) : strings.form.noNumber}</p>}
      {locked !== null && (
        <p class="quiet" lang="en">
          {locked}
        </p>
      )}
    </form>
  );
}
