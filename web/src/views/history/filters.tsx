import type { Filter } from "../../job/query";
import { KINDS } from "../../job/kinds";
import { strings } from "../../strings";
import type { JobKind, JobState } from "../../daemon/wire";

const STATES = Object.keys(strings.job.state) as JobState[];

interface Props {
  filter: Filter;
  set: (filter: Filter) => void;
}

/** What is looked for. */
export function Filters({ filter, set }: Props) {
  return (
    <form class="filters" role="search" onSubmit={(event) => event.preventDefault()}>
      <label class="wide">
        <span>{strings.history.search}</span>
        <input
          type="search"
          id="search"
          value={filter.text}
          placeholder={strings.history.searchMore}
          onInput={(event) => set({ ...filter, text: event.currentTarget.value })}
        />
      </label>
      <label>
        <span>{strings.history.kind}</span>
        <select
          value={filter.kind}
          onChange={(event) => set({ ...filter, kind: event.currentTarget.value as JobKind | "" })}
        >
          <option value="">{strings.history.any}</option>
          {KINDS.map((kind) => (
            <option key={kind} value={kind}>
              {strings.job.kinds[kind]}
            </option>
          ))}
        </select>
      </label>
      <label>
        <span>{strings.history.state}</span>
        <select
          id="state"
          value={filter.state}
          onChange={(event) => set({ ...filter, state: event.currentTarget.value as JobState | "" })}
        >
          <option value="">{strings.history.any}</option>
          {STATES.map((state) => (
            <option key={state} value={state}>
              {strings.job.state[state]}
            </option>
          ))}
        </select>
      </label>
      <label>
        <span>{strings.history.since}</span>
        <input
          type="date"
          value={filter.since}
          onInput={(event) => set({ ...filter, since: event.currentTarget.value })}
        />
      </label>
      <label>
        <span>{strings.history.until}</span>
        <input
          type="date"
          value={filter.until}
          onInput={(event) => set({ ...filter, until: event.currentTarget.value })}
        />
      </label>
    </form>
  );
}
