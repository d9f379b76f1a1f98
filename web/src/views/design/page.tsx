import { useEffect, useMemo, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import type { JsonObject } from "../../design/config-schema";
import { awaited, count, difference, rebased } from "../../design/draft";
import type { State } from "../../state";
import { strings } from "../../strings";
import { Newest } from "../../daemon/newest";
import { reworded, UNITS, type LengthUnit } from "../../words/units";
import type { ConfigFault, Draft, DraftBase } from "../../daemon/wire";
import { useConfigFile } from "../config-file";
import type { Given } from "../given";
import { useKept } from "../kept";
import { Old } from "../old";
import { Choice } from "../toggle";
import { Curves } from "./curves";
import { DraftFields } from "./fields";
import { Figures } from "./figures";
import { Save } from "./save";
import { Summary } from "./summary";
import { Drawings } from "./train";

/** Between the last key pressed and the question, ms: results are to follow at once. */
const REST_MS = 120;
const COMPARISONS = ["nothing", "in_force", "preset"] as const;
const RESULTS = "design-results";
type Comparison = (typeof COMPARISONS)[number];

/** What a camera would come to. */
export function DesignPage(given: Given) {
  const { state, newest: stateNow, update, load } = given;
  const [{ inForce, preset, shown }, setCameras] = useKept(given, "cameras");
  const { file, read } = useConfigFile(given);
  const [drafted, setDrafted] = useKept(given, "draftedCamera");
  const [faults, setFaults] = useState<ConfigFault[] | null>(null);
  const [working, setWorking] = useState(false);
  const [comparison, compare] = useState<Comparison>("nothing");
  const [newest] = useState(() => new Newest());
  const connected = state.link === "open";

  const configured = inForce?.config as JsonObject | undefined;
  const base = useMemo(() => configured && awaited(configured, file), [configured, file]);
  const edited = drafted?.draft ?? base;
  const learn = (part: Partial<State["cameras"]>) => {
    // What was on its way when somebody signed out is not for the next one.
    if (stateNow().session !== "stranger") setCameras({ ...stateNow().cameras, ...part });
  };
  useEffect(() => {
    if (!connected) return;
    const ask = (base: DraftBase, set: (draft: Draft) => void) =>
      load(
        api.draftDesign(base, {}).then((result) => {
          if (result.ok) set(result.value);
          return result;
        }),
      );
    void ask("in_force", (draft) => learn({ inForce: draft, shown: stateNow().cameras.shown ?? draft }));
    void ask("preset", (draft) => learn({ preset: draft }));
  }, [state.bootId, connected]);
  useEffect(() => {
    // What has been edited stays so, over what the file holds by now; the rest goes with it.
    const kept = stateNow().draftedCamera;
    if (kept && base) setDrafted({ draft: rebased(kept.draft, kept.over, base), over: base });
  }, [base]);

  const changes = base && edited ? difference(base, edited) : {};
  // What is worked out begins from the camera in force, as the daemon does.
  const asked = configured && edited ? difference(configured, edited) : {};
  useEffect(() => {
    setWorking(connected);
    if (!edited || !base || !connected) return undefined;
    const timer = setTimeout(() => {
      void newest.of(api.draftDesign("in_force", asked)).then((result) => {
        if (result === null) return;
        setWorking(false);
        if (result.ok) {
          learn({ shown: result.value });
          setFaults(null);
        } else if ([409, 422].includes(result.problem.status)) {
          setFaults(result.problem.problems ?? [{ key: "", message: result.problem.detail }]);
        } else {
          update({ problem: result.problem });
        }
      });
    }, REST_MS);
    return () => clearTimeout(timer);
  }, [edited, base, connected]);

  if (!shown || !edited || !base) return connected ? null : <Unheard />;
  const { unit } = state.preferences;
  const against = comparison === "in_force" ? inForce : comparison === "preset" ? preset : null;
  const other =
    against && comparison !== "nothing"
      ? { name: strings.design.compared[comparison], draft: against }
      : null;
  const wrong = faults !== null;
  const stale = wrong || !connected;
  return (
    <div class="design-page">
      <div class="draft-column">
        <section class="card draft" aria-label={strings.design.title}>
          <h2>
            {strings.design.title}
            <Old {...given} />
          </h2>
          <p class="quiet">{strings.design.more}</p>
          <p class="row">
            <span>{strings.design.units}</span>
            <Choice
              label={strings.design.units}
              of={UNITS}
              chosen={unit}
              choose={(unit) => update({ preferences: { ...state.preferences, unit } })}
            />
          </p>
          <DraftFields
            base={base}
            edited={edited}
            waterIndex={shown.design.water_refractive_index}
            faults={faults ?? []}
            unit={unit}
            set={(draft) => setDrafted({ draft, over: base })}
          />
          <p class="actions">
            <button
              type="button"
              id="back"
              aria-disabled={count(changes) === 0}
              onClick={() => setDrafted(null)}
            >
              {strings.design.reset}
            </button>
          </p>
          <Save
            {...given}
            file={file}
            read={read}
            changes={changes}
            wrong={wrong}
            working={working}
            obstacles={shown.obstacles}
          />
        </section>
        <Summary draft={shown} unit={unit} wrong={wrong} stale={stale} results={RESULTS} />
      </div>
      <div class="column outcome-column" data-stale={stale} aria-busy={working}>
        {faults && (
          <div class="notice wrong" role="alert">
            <p>{strings.design.impossible}</p>
            <Strays faults={faults} unit={unit} />
          </div>
        )}
        <section class="card" id={RESULTS} tabIndex={-1} aria-label={strings.design.figures}>
          <h2>
            {strings.design.figures}
            <span class="quiet" role="status">
              {working ? strings.design.working : ""}
            </span>
            <Old {...given} />
          </h2>
          <p class="row compare-with">
            <span>{strings.design.compare}</span>
            <Choice
              label={strings.design.compare}
              of={COMPARISONS}
              chosen={comparison}
              name={(one) => strings.design.comparison[one]}
              choose={compare}
            />
          </p>
          <Figures draft={shown} other={other} unit={unit} />
        </section>
        <Drawings draft={shown} other={other} unit={unit} />
        <Curves draft={shown} other={other} unit={unit} />
      </div>
    </div>
  );
}

/** Where the daemon has not been heard since this page was opened. */
function Unheard() {
  return (
    <section class="card" aria-label={strings.design.title}>
      <h2>{strings.design.title}</h2>
      <p>{strings.design.unheard}</p>
    </section>
  );
}

/** What is wrong and has no field to be said at. */
function Strays({ faults, unit }: { faults: ConfigFault[]; unit: LengthUnit }) {
  const strays = faults.filter((fault) => !(fault.key in strings.design.field));
  return (
    <>
      {faults.length > strays.length && <p>{strings.design.wrong(faults.length - strays.length)}</p>}
      {strays.map((fault) => (
        <p key={fault.key}>
          <b>{fault.key}</b> <span lang="en">{reworded(fault.message, unit)}</span>
        </p>
      ))}
    </>
  );
}
