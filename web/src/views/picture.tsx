import { fixed } from "../format";
import { pictureAge, pictureState, type State } from "../state";
import { strings } from "../strings";

const CANVAS_ID = "live";

/** Draws a JPEG on the canvas; false when it cannot be read. */
export async function drawPicture(jpeg: Uint8Array<ArrayBuffer>): Promise<boolean> {
  const canvas = document.getElementById(CANVAS_ID);
  if (!(canvas instanceof HTMLCanvasElement)) return false;
  try {
    const bitmap = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      canvas.width = bitmap.width;
      canvas.height = bitmap.height;
    }
    canvas.getContext("2d", { alpha: false })?.drawImage(bitmap, 0, 0);
    bitmap.close();
    return true;
  } catch {
    return false;
  }
}

export function LivePicture({ state, now }: { state: State; now: number }) {
  const shown = pictureState(state, now);
  const age = pictureAge(state, now);
  const facts = state.picture;
  const offline = state.bench && !state.bench.camera.online;
  return (
    <section class="card picture" data-state={shown} aria-label={strings.live}>
      <div class="frame">
        <canvas id={CANVAS_ID} width={1160} height={1160} />
        {facts?.simulated && <span class="stamp">{strings.simulated}</span>}
        {facts?.replayed && <span class="stamp">{strings.replay}</span>}
        {shown === "none" && <p class="over">{strings.noPicture}</p>}
        {shown === "stale" && age !== null && <p class="over">{strings.stale(fixed(age / 1000, 0))}</p>}
      </div>
      <p class="facts">
        {facts && age !== null && <span>{strings.frame(facts.seq, fixed(age, 0), facts.framesSkipped)}</span>}
        {facts?.preview && <span class="tag">{strings.preview}</span>}
        {facts && !facts.settled && <span class="tag">{strings.moving}</span>}
        {offline && (
          <span class="tag bad">
            {strings.cameraOffline}
            {state.bench?.camera.fault ? `: ${state.bench.camera.fault}` : ""}
          </span>
        )}
      </p>
      {state.bench?.camera.notes.map((note) => (
        <p class="facts" role="note" key={note}>
          {note}
        </p>
      ))}
    </section>
  );
}
