import type { ComponentChildren } from "preact";

interface Props {
  on: boolean;
  set: (on: boolean) => void;
  title?: string;
  disabled?: boolean;
  id?: string;
  children: ComponentChildren;
}

/** A button that is in or out. No checkbox: the space bar may be the stop key, and Enter does not reach a checkbox. */
export function Toggle({ on, set, title, disabled, id, children }: Props) {
  return (
    <button
      type="button"
      id={id}
      class="toggle"
      aria-pressed={on}
      title={title}
      disabled={disabled}
      onClick={() => set(!on)}
    >
      {children}
    </button>
  );
}

interface ChoiceProps<T extends string | number> {
  label: string;
  of: readonly T[];
  chosen: T;
  name?: (choice: T) => string;
  disabled?: boolean;
  choose: (choice: T) => void;
}

/** One of a few. */
export function Choice<T extends string | number>({
  label,
  of,
  chosen,
  name,
  disabled,
  choose,
}: ChoiceProps<T>) {
  return (
    <span class="choice" role="group" aria-label={label}>
      {of.map((one) => (
        <button
          key={one}
          type="button"
          class="toggle"
          aria-pressed={one === chosen}
          disabled={disabled}
          onClick={() => choose(one)}
        >
          {name ? name(one) : one}
        </button>
      ))}
    </span>
  );
}
