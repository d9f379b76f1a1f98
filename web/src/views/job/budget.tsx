import { fixed } from "../../words/format";
import { strings } from "../../strings";
import { bare, reworded, type LengthUnit } from "../../words/units";
import type { Budget } from "../../daemon/wire";
import { Explained } from "../term";

/** What an alignment's figures are uncertain by, part by part, and whether that is good enough. */
export function BudgetTable({ budget, unit }: { budget: Budget; unit: LengthUnit }) {
  const words = strings.report.budget;
  const rows = [
    ...budget.parts,
    {
      name: words.together,
      delta_v_mm: budget.delta_v_sigma_mm,
      e_mm: budget.e_sigma_mm,
      off_focus_px: budget.off_focus_sigma_px,
      remedy: "",
    },
  ];
  return (
    <>
      <p class="verdict" lang="en">
        {reworded(budget.conclusion, unit)}
      </p>
      <details>
        <summary>{words.title}</summary>
        <div class="table budget" tabIndex={0} role="region" aria-label={words.title}>
          <table>
            <thead>
              <tr>
                {words.heads(unit).map((head) => (
                  <th key={head} scope="col">
                    <Explained text={head} />
                  </th>
                ))}
              </tr>
            </thead>
            <tbody>
              {rows.map((part) => (
                <tr key={part.name}>
                  <th scope="row" lang={part.name === words.together ? undefined : "en"}>
                    {part.name}
                  </th>
                  <td>{bare(part.delta_v_mm, unit, 5)}</td>
                  <td>{bare(part.e_mm, unit, 4)}</td>
                  <td>{fixed(part.off_focus_px, 4)}</td>
                  <td class="words" lang="en">
                    {part.remedy}
                  </td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      </details>
    </>
  );
}
