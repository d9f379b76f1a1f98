import { may } from "../../state";
import type { Scene } from "../scene";
import { Configuration } from "./configuration";
import { Devices } from "./devices";
import { Faults } from "./faults";
import { Preferences } from "./preferences";
import { Records } from "./records";
import { Tokens } from "./tokens";

/** What can be set: this page, the bench, who gets in. */
export function SettingsPage(scene: Scene) {
  return (
    <div class="settings-page">
      <div class="column">
        <Preferences {...scene} />
        <Devices {...scene} />
        {scene.state.bench?.simulated && <Faults {...scene} />}
        {may(scene.state, "admin") && <Tokens {...scene} />}
        <Records {...scene} />
      </div>
      <Configuration {...scene} />
    </div>
  );
}
