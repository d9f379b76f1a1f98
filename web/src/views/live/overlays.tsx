import { fixed } from "../../words/format";
import { eyepiece } from "../../picture/eyepiece";
import { OVERLAYS, type Overlay } from "../../preferences";
import { strings } from "../../strings";
import type { Given } from "../given";
import { SHOWS } from "../../picture/show";
import { Choice, Toggle } from "../toggle";

const ZOOM = 2;

/** What the picture shows, what is laid over it, and how near one looks. */
export function Overlays({ state, update }: Given) {
  const { overlays, show } = state.preferences;
  const set = (overlay: Overlay, on: boolean) => {
    const next = OVERLAYS.filter((one) => (one === overlay ? on : overlays.includes(one)));
    update({ preferences: { ...state.preferences, overlays: next } });
  };
  const scale = eyepiece.scale;
  return (
    <div class="tools">
      <Choice
        label={strings.picture.show}
        of={SHOWS}
        chosen={show}
        name={(one) => strings.picture.shown[one]}
        choose={(one) => update({ preferences: { ...state.preferences, show: one } })}
      />
      <span class="choice" role="group" aria-label={strings.picture.overlays}>
        {OVERLAYS.map((overlay) => (
          <Toggle
            key={overlay}
            on={overlays.includes(overlay)}
            disabled={show !== "raw"}
            set={(on) => set(overlay, on)}
            title={strings.picture.overlayMore[overlay]}
          >
            {strings.picture.overlay[overlay]}
          </Toggle>
        ))}
      </span>
      <span class="choice" role="group" aria-label={strings.picture.zoom}>
        <button type="button" aria-label={strings.picture.zoomOut} onClick={() => eyepiece.zoom(1 / ZOOM)}>
          −
        </button>
        <button type="button" title={strings.picture.wholeMore} onClick={() => eyepiece.all()}>
          {strings.picture.whole}
        </button>
        <button type="button" title={strings.picture.pixelsMore} onClick={() => eyepiece.pixelForPixel()}>
          {strings.picture.pixels}
        </button>
        <button type="button" aria-label={strings.picture.zoomIn} onClick={() => eyepiece.zoom(ZOOM)}>
          +
        </button>
        <output class="facts">
          {scale === null ? "" : strings.picture.scale(fixed(scale, scale < 10 ? 1 : 0))}
        </output>
      </span>
    </div>
  );
}
