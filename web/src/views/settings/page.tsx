import { may } from "../../state";
import type { Given } from "../given";
import { Configuration } from "./configuration";
import { Devices } from "./devices";
import { Faults } from "./faults";
import { Preferences } from "./preferences";
import { Records } from "./records";
import { Tokens } from "./tokens";

/** What can be set: this page, the bench, who gets in. */
export function SettingsPage(given: Given) {
  return (
    <div class="settings-page">
      <div class="column">
        <Preferences {...given} />
        <Devices {...given} />
        {given.state.bench?.simulated && <Faults {...given} />}
        {may(given.state, "admin") && <Tokens {...given} />}
        <Records {...given} />
      </div>
      <Configuration {...given} />
    </div>
  );
}
