import { sentence } from "../words/format";
import { strings } from "../strings";
import type { Bench } from "../daemon/wire";

/** That the camera or a stage is gone, on every page: what is done there rests on them. That the camera gives an old picture
 *  again is seen where its pictures are. */
export function Absences({ bench, frozen }: { bench: Bench; frozen: boolean }) {
  const gone = bench.axes.filter((axis) => !axis.connected);
  const faults = [...new Set(gone.flatMap((axis) => axis.fault ?? []))];
  const { camera } = bench;
  return (
    <>
      {!camera.online && (
        <div class="problem" role="alert" id="camera-gone">
          <p>
            <b>{strings.cameraGone}.</b>{" "}
            {camera.fault ? <span lang="en">{sentence(camera.fault)}</span> : strings.cameraGoneMore}
          </p>
        </div>
      )}
      {camera.online && frozen && (
        <div class="problem" role="alert" id="camera-frozen">
          <p>
            <b>{strings.cameraFrozen}.</b> {strings.cameraFrozenMore}
          </p>
        </div>
      )}
      {gone.length > 0 && (
        <div class="problem" role="alert" id="stage-gone">
          <p>
            <b>{strings.stageGone(gone.map((axis) => strings.axis.name[axis.axis]))}.</b>{" "}
            {faults.length > 0 ? <span lang="en">{sentence(faults.join("; "))}</span> : strings.stageGoneMore}
          </p>
        </div>
      )}
    </>
  );
}
