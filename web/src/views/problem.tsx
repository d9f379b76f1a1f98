import { strings } from "../strings";
import type { Problem } from "../wire";

/** What went wrong, in the server's words. */
export function ProblemLine({ problem, dismiss }: { problem: Problem; dismiss?: () => void }) {
  return (
    <div class="problem" role="alert">
      <p>
        <b>{problem.title}.</b> {problem.detail}
      </p>
      {dismiss && (
        <button type="button" onClick={dismiss}>
          {strings.dismiss}
        </button>
      )}
    </div>
  );
}
