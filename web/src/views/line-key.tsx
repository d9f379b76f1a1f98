import type { ComponentChildren } from "preact";

interface Props {
  of: "accent" | "second" | "good";
  children: ComponentChildren;
}

/** What a line of a chart is, beside a piece of it. */
export function LineKey({ of, children }: Props) {
  return (
    <span class="line-key">
      <span class={`line ${of}`} /> <span>{children}</span>
    </span>
  );
}
