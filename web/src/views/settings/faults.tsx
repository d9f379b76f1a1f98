import { useEffect, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { able, may } from "../../state";
import { numberOf } from "../../words/number";
import { Newest } from "../../daemon/newest";
import { strings } from "../../strings";
import { inUnit, typedMm } from "../../words/units";
import type { AxisName, FaultPlan, FaultPlanInForce, Faults as Wrong, FaultsChange } from "../../daemon/wire";
import type { Given } from "../given";
import { Choice, Toggle } from "../toggle";

const PICTURES = ["none", "dark", "saturated", "blurred", "torn"] as const;
const AXES: readonly AxisName[] = ["focus", "e"];
const PERCENT = 100;
/** Between two looks at what goes wrong, ms. */
const EVERY_MS = 2000;

/** Whether something comes or goes by itself still. */
function isToCome({ plan, elapsed_s }: FaultPlanInForce): boolean {
  const last = ({ at_s, lasts_s }: FaultPlan["events"][number]) => at_s + (lasts_s ?? 0);
  return plan?.events.some((event) => last(event) > (elapsed_s ?? 0)) ?? false;
}

/** What is made to go wrong with the simulated bench, and what more could be. */
export function Faults({ state, act, load }: Given) {
  const [wrong, setWrong] = useState<Wrong | null>(null);
  const [planned, setPlanned] = useState(false);
  const [[newest, newestPlan]] = useState(() => [new Newest(), new Newest()] as const);
  const shown = (asked: ReturnType<typeof api.faults>) => {
    void newest.of(asked).then((result) => result?.ok && setWrong(result.value));
    void newestPlan.of(api.faultPlan()).then((result) => result?.ok && setPlanned(isToCome(result.value)));
    return asked;
  };
  useEffect(() => {
    void load(shown(api.faults()));
    // Others make things go wrong as well, and a plan does by itself.
    const timer = setInterval(() => void shown(api.faults()), EVERY_MS);
    return () => clearInterval(timer);
  }, [state.bootId]);
  if (!wrong) return null;
  const words = strings.faults;
  const { unit } = state.preferences;
  const said = (mm: number) => inUnit(mm, unit);
  const allowed = able(state, "control");
  const set = (change: FaultsChange) => void act(shown(api.changeFaults(change)));
  const { serial, camera, scene, disk } = wrong;
  const parts = [serial, camera, scene, disk, wrong.focus, wrong.e];
  const any = parts.some((part) => Object.values(part).some((value) => value && value !== "none"));
  return (
    <section class="card faults" aria-label={words.title}>
      <h2>
        {words.title}
        <button
          type="button"
          id="faults-none"
          disabled={!allowed}
          // Whoever pressed it is still there once nothing is wrong any more.
          aria-disabled={!(any || planned)}
          onClick={() => (any || planned) && void act(shown(api.clearFaults()))}
        >
          {words.good}
        </button>
      </h2>
      <p class="quiet">{may(state, "control") ? words.more : strings.viewOnly}</p>
      <p id="faults-state" class={any ? "fault" : ""}>
        {any ? words.some : planned ? words.noneYet : words.none}
      </p>
      {planned && <p id="faults-planned">{words.planned}</p>}
      <fieldset disabled={!allowed}>
        <legend>{words.camera}</legend>
        <p class="row">
          <Toggle on={camera.unplugged} set={(unplugged) => set({ camera: { unplugged } })}>
            {words.unplugged}
          </Toggle>
          <Toggle on={camera.frozen} set={(frozen) => set({ camera: { frozen } })}>
            {words.frozen}
          </Toggle>
        </p>
        <p class="row">
          <span>{words.picture}</span>
          <Choice
            label={words.picture}
            of={PICTURES}
            chosen={camera.picture}
            name={(picture) => words.pictures[picture]}
            choose={(picture) => set({ camera: { picture } })}
          />
        </p>
      </fieldset>
      <fieldset disabled={!allowed}>
        <legend>{words.scene}</legend>
        <p class="row">
          <Toggle on={scene.tank_empty} set={(tank_empty) => set({ scene: { tank_empty } })}>
            {words.tankEmpty}
          </Toggle>
          <Toggle on={scene.no_shell} set={(no_shell) => set({ scene: { no_shell } })}>
            {words.noShell}
          </Toggle>
        </p>
        <Figure
          label={words.bubbles}
          value={scene.bubbles}
          range={[0, 500, 1]}
          set={(bubbles) => set({ scene: { bubbles } })}
        />
        <Figure
          key={`displaced-${unit}`}
          label={words.displaced(unit)}
          value={said(scene.board_displaced_mm)}
          range={[said(-300), said(1000), "any"]}
          set={(length) => set({ scene: { board_displaced_mm: typedMm(length, unit) } })}
        />
        <Figure
          label={words.turned}
          value={scene.board_turned_mrad}
          range={[-300, 300, "any"]}
          set={(board_turned_mrad) => set({ scene: { board_turned_mrad } })}
        />
        <Figure
          key={`second-${unit}`}
          label={words.secondBoard(unit)}
          value={said(scene.second_board_mm)}
          range={[0, said(300), "any"]}
          set={(length) => set({ scene: { second_board_mm: typedMm(length, unit) } })}
        />
        <Figure
          key={`otherShell-${unit}`}
          label={words.otherShell(unit)}
          value={said(scene.shell_radius_mm)}
          range={[said(-20), said(200), "any"]}
          set={(length) => set({ scene: { shell_radius_mm: typedMm(length, unit) } })}
        />
      </fieldset>
      {AXES.map((axis) => {
        const of = wrong[axis];
        const change = (part: Partial<typeof of>) => set({ [axis]: part });
        return (
          <fieldset key={axis} disabled={!allowed}>
            <legend>{words.axis[axis]}</legend>
            <p class="row">
              <Toggle on={of.stalled} set={(stalled) => change({ stalled })}>
                {words.stalled}
              </Toggle>
              <Toggle on={of.limit_switch} set={(limit_switch) => change({ limit_switch })}>
                {words.limitSwitch}
              </Toggle>
            </p>
            <Figure
              label={words.slip}
              value={PERCENT * of.slip_share}
              range={[0, PERCENT, "any"]}
              set={(percent) => change({ slip_share: percent / PERCENT })}
            />
            <Figure
              key={`backlash-${unit}`}
              label={words.backlash(unit)}
              value={said(of.backlash_mm)}
              range={[0, said(5), "any"]}
              set={(length) => change({ backlash_mm: typedMm(length, unit) })}
            />
            <Figure
              key={`growth-${unit}`}
              label={words.growth(unit)}
              value={said(of.backlash_growth_mm)}
              range={[0, said(1), "any"]}
              set={(length) => change({ backlash_growth_mm: typedMm(length, unit) })}
            />
            <Figure
              label={words.stopsLate}
              value={of.stops_late_ms}
              range={[0, 5000, 1]}
              set={(stops_late_ms) => change({ stops_late_ms })}
            />
          </fieldset>
        );
      })}
      <fieldset disabled={!allowed}>
        <legend>{words.serial}</legend>
        <p class="row">
          <Toggle on={serial.unplugged} set={(unplugged) => set({ serial: { unplugged } })}>
            {words.unplugged}
          </Toggle>
          <Toggle on={serial.unpowered} set={(unpowered) => set({ serial: { unpowered } })}>
            {words.unpowered}
          </Toggle>
        </p>
        <Figure
          label={words.delay}
          value={serial.delay_ms}
          range={[0, 5000, 1]}
          set={(delay_ms) => set({ serial: { delay_ms } })}
        />
        <Figure
          label={words.lost}
          value={serial.lost_one_in}
          range={[0, 1_000_000, 1]}
          set={(lost_one_in) => set({ serial: { lost_one_in } })}
        />
        <Figure
          label={words.garbled}
          value={serial.garbled_one_in}
          range={[0, 1_000_000, 1]}
          set={(garbled_one_in) => set({ serial: { garbled_one_in } })}
        />
      </fieldset>
      <fieldset disabled={!allowed}>
        <legend>{words.disk}</legend>
        <p class="row">
          <Toggle on={disk.full} set={(full) => set({ disk: { full } })}>
            {words.full}
          </Toggle>
        </p>
        <Figure
          label={words.slow}
          value={disk.delay_ms}
          range={[0, 5000, 1]}
          set={(delay_ms) => set({ disk: { delay_ms } })}
        />
      </fieldset>
    </section>
  );
}

/** What is wrong with a number; empty where it may be. */
function faultOf(value: number, [low, high, step]: FigureProps["range"]): string {
  if (!Number.isFinite(value)) return strings.form.noNumber;
  if (step === 1 && !Number.isInteger(value)) return strings.form.notWhole;
  return value < low || value > high ? strings.form.outside(String(low), String(high)) : "";
}

interface FigureProps {
  label: string;
  value: number;
  /** Least, greatest, and whether it has to be whole. */
  range: [number, number, 1 | "any"];
  set: (value: number) => void;
}

/** A number that holds when it is left; 0 is none of it. */
function Figure({ label, value, range: [min, max, step], set }: FigureProps) {
  // What is being typed, or could not be taken; null while what holds is shown.
  const [text, setText] = useState<string | null>(null);
  const [left, setLeft] = useState(false);
  const fault = text !== null && left ? faultOf(numberOf(text), [min, max, step]) : "";
  const take = (text: string) => {
    setLeft(true);
    if (faultOf(numberOf(text), [min, max, step]) !== "") return;
    setText(null);
    set(numberOf(text));
  };
  return (
    <label class="row">
      <span>{label}</span>
      {/* Of type "number" a browser would show its own decimal sign, beside the page's. */}
      <input
        inputMode="decimal"
        value={text ?? value}
        aria-invalid={fault !== ""}
        onInput={(event) => {
          setLeft(false);
          setText(event.currentTarget.value);
        }}
        onChange={(event) => take(event.currentTarget.value)}
      />
      {fault && (
        <span class="fault" role="alert">
          {fault}
        </span>
      )}
    </label>
  );
}
