import { Bench } from "../bench/control";
import { JobStrip } from "../job/strip";
import type { Scene } from "../scene";
import { Charts } from "./charts";
import { Meter } from "./meter";
import { LivePicture } from "./picture";

/** What an assembler works by. */
export function LivePage(scene: Scene) {
  return (
    <div class="live-page">
      <div class="column">
        <LivePicture {...scene} />
        <JobStrip {...scene} />
      </div>
      <div class="column">
        <Meter {...scene} />
        <Bench {...scene} />
      </div>
      <Charts {...scene} />
    </div>
  );
}
