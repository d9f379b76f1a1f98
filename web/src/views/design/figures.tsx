import { degrees } from "../../design/draft";
import { fixed } from "../../words/format";
import { strings } from "../../strings";
import { length, pixels, reworded, signedLength, type LengthUnit } from "../../words/units";
import type { Draft, DraftState } from "../../daemon/wire";
import { Explained } from "../term";

/** Another camera, to be compared with. */
export interface Other {
  name: string;
  draft: Draft;
}

interface Props {
  draft: Draft;
  other: Other | null;
  unit: LengthUnit;
}

type Row = [name: string, of: (state: DraftState) => string | null];

function rows(unit: LengthUnit): Row[] {
  const words = strings.design;
  const { figure } = words;
  const end = (mm: number | null | undefined, digits: number) =>
    typeof mm === "number" ? length(mm, unit, digits) : words.infinity;
  return [
    [figure.deltaV, (state) => signedLength(state.delta_v_mm, unit, 3)],
    [figure.e, (state) => (typeof state.e_mm === "number" ? length(state.e_mm, unit, 2) : null)],
    [figure.aperture, (state) => length(state.aperture_mm, unit, 3)],
    [figure.ring, (state) => fixed(state.aperture_ring_f_number, 2)],
    [figure.fov, (state) => degrees(state.fov_deg) ?? words.cut],
    [
      figure.board,
      (state) =>
        typeof state.board_width_mm === "number" ? length(state.board_width_mm, unit, 1) : words.cut,
    ],
    [figure.blur, (state) => pixels(state.blur_px, 2)],
    [
      figure.depth,
      ({ depth_of_field: depth }) =>
        depth ? words.between(end(depth.near_mm, 0), end(depth.far_mm, 0)) : words.unsharp,
    ],
    [
      figure.tolerance,
      ({ e_tolerance: tolerance }) => {
        if (!tolerance) return null;
        const { low_mm: low, high_mm: high } = tolerance;
        if (typeof low === "number" && typeof high === "number")
          return words.between(length(low, unit, 2), length(high, unit, 2));
        if (typeof low === "number") return words.from(length(low, unit, 2));
        return typeof high === "number" ? words.upTo(length(high, unit, 2)) : words.any;
      },
    ],
    [
      figure.reoptimise,
      ({ reoptimise }) => {
        if (!reoptimise) return null;
        const delta = (mm: number | null | undefined) =>
          typeof mm === "number" ? signedLength(mm, unit, 3) : words.never;
        return `${delta(reoptimise.near_delta_v_mm)} /\n${delta(reoptimise.far_delta_v_mm)}`;
      },
    ],
  ];
}

/** What a camera comes to, state by state, and another beside it. */
export function Figures({ draft, other, unit }: Props) {
  const words = strings.design;
  const named = (from: Draft, name: DraftState["state"]) => from.states.find((state) => state.state === name);
  return (
    <>
      <div class="table" tabIndex={0} role="group" aria-label={words.figures}>
        <table class="figures">
          <thead>
            <tr>
              <td />
              {draft.states.map(({ state }) => (
                <th key={state} scope="col">
                  {words.state[state]}
                  <small>{words.stateMore[state]}</small>
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {rows(unit).map(([name, of]) => (
              <tr key={name}>
                <th scope="row">
                  <Explained text={name} />
                </th>
                {draft.states.map((state) => {
                  const its = other && named(other.draft, state.state);
                  return (
                    <td key={state.state} data-state={state.state}>
                      {of(state) ?? words.none}
                      {its && (
                        <small class="other" data-differs={of(its) !== of(state)}>
                          {of(its) ?? words.none}
                        </small>
                      )}
                    </td>
                  );
                })}
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {other && (
        <p class="facts">
          {words.yours}, <span class="other">{other.name}</span>
        </p>
      )}
      <Rest draft={draft} unit={unit} />
    </>
  );
}

function Rest({ draft, unit }: Omit<Props, "other">) {
  const words = strings.design.rest;
  const { design } = draft;
  const depth = ([one, three]: number[]) =>
    words.depthOf(length(one ?? NaN, unit, 1), length(three ?? NaN, unit, 1));
  const rows: [string, string][] = [
    [words.target, pixels(design.spacing_target_px, 3)],
    [words.eBest, length(design.fov_optimal_e_mm, unit, 2)],
    [words.eMax, length(design.e_max_mm, unit, 1)],
    [
      words.array,
      words.arrayOf(
        length(design.mla.a_mm, unit, 4),
        length(design.mla.b_mm, unit, 4),
        fixed(design.mla.f_number, 2),
      ),
    ],
    [words.depthAir, depth(design.depth_resolution_mm)],
    [words.depthWater, depth(design.depth_resolution_water_mm)],
  ];
  return (
    <>
      <dl class="rest">
        {rows.map(([name, value]) => (
          <div key={name}>
            <dt>
              <Explained text={name} />
            </dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      {design.notices.map((notice) => (
        <p class="notice" lang="en" key={notice}>
          {reworded(notice, unit)}
        </p>
      ))}
    </>
  );
}
