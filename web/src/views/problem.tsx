import { sentence } from "../words/format";
import { strings } from "../strings";
import { reworded, type LengthUnit } from "../words/units";
import type { Problem } from "../daemon/wire";

interface Props {
  problem: Problem;
  /** The unit of the lengths in it. */
  unit?: LengthUnit;
  dismiss?: () => void;
}

/** What went wrong, in the server's words. */
export function ProblemLine({ problem, unit = "mm", dismiss }: Props) {
  return (
    <div class="problem" role="alert">
      <p lang={problem.status === 0 ? undefined : "en"}>
        <b>{problem.title}.</b> {sentence(reworded(problem.detail, unit))}
      </p>
      {dismiss && (
        <button type="button" onClick={dismiss}>
          {strings.dismiss}
        </button>
      )}
    </div>
  );
}
