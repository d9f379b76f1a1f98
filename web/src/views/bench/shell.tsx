import * as api from "../../daemon/api";
import { strings } from "../../strings";
import type { ShellState } from "../../daemon/wire";
import { Ask } from "../ask";
import { useAsked } from "../asked";
import type { Given } from "../given";
import { Choice } from "../toggle";

const STATES = ["on", "off", "unknown"] as const;

interface Props extends Given {
  shell: ShellState;
  disabled: boolean;
}

/** Whether the shell is on, as the operator says. */
export function Shell({ act, shell, disabled }: Props) {
  const [asking, ask] = useAsked<true>(!disabled);
  // "Off" opens the way for the e axis: on the operator's word only.
  const choose = (state: ShellState) => {
    ask(state === "off" ? true : null);
    if (state !== "off") void act(api.setShell(state));
  };
  return (
    <div class="shell">
      <p class="paces">
        <span class="quiet">{strings.shell.title}</span>
        <Choice
          label={strings.shell.title}
          of={STATES}
          chosen={shell}
          name={(state) => strings.shell.state[state]}
          disabled={disabled}
          choose={choose}
        />
      </p>
      {asking && (
        <Ask
          question={strings.shell.sure}
          yes={strings.shell.yes}
          no={strings.shell.no}
          answer={(yes) => {
            ask(null);
            if (yes) void act(api.setShell("off"));
          }}
        />
      )}
    </div>
  );
}
