import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../../daemon/api";
import { fixed } from "../../words/format";
import { drawn } from "../../picture/histogram";
import { isFrozen } from "../../state";
import { strings } from "../../strings";
import type { Histogram } from "../../daemon/wire";
import type { Given } from "../given";

/** Between two histograms, ms. */
const EVERY_MS = 1000;

/** Counts the newest frame once a second, for as long as it is in sight: nobody looking, nothing is counted. */
function useHistogram(online: boolean) {
  const seen = useRef<HTMLElement>(null);
  // Undefined until it has been asked for, null where there is none.
  const [histogram, keep] = useState<Histogram | null | undefined>(undefined);
  useEffect(() => {
    const element = seen.current;
    if (!online || !element) return keep(null);
    keep(undefined);
    let [inSight, over] = [false, false];
    let timer: ReturnType<typeof setTimeout> | null = null;
    const look = async () => {
      timer = null;
      if (over || !inSight) return;
      if (!document.hidden) {
        const answer = await api.histogram();
        if (over) return;
        keep(answer.ok ? answer.value : null);
      }
      timer ??= setTimeout(() => void look(), EVERY_MS);
    };
    const observer = new IntersectionObserver((entries) => {
      inSight = entries.some((entry) => entry.isIntersecting);
      if (inSight && timer === null) timer = setTimeout(() => void look(), 0);
    });
    observer.observe(element);
    return () => {
      over = true;
      observer.disconnect();
      if (timer !== null) clearTimeout(timer);
    };
  }, [online]);
  return { seen, histogram };
}

/** The grey levels of the newest frame, what is clipped in red. */
export function HistogramView({ state, now }: Given) {
  const online = state.link === "open" && state.bench?.camera.online === true;
  const { seen, histogram } = useHistogram(online);
  const words = strings.camera;
  const clipped = histogram?.overexposed === true;
  const old = isFrozen(state, now);
  return (
    <figure
      ref={seen}
      class="histogram"
      data-clipped={clipped}
      data-old={old}
      data-seq={histogram?.frame_seq}
    >
      {histogram ? (
        <Steps histogram={histogram} />
      ) : (
        <p class="quiet">{histogram === null && words.histogramNone}</p>
      )}
      <figcaption class="facts">
        <span title={words.histogramMore}>{words.histogram}</span>
        {old && <span class="tag old">{strings.measuring.old}</span>}
        {histogram && (
          <>
            <span>{words.bits(histogram.bits)}</span>
            <span title={words.blackMore}>{words.black(fixed(100 * histogram.black_share, 1))}</span>
            <span id="clipped" class={clipped ? "tag bad" : undefined} title={words.clippedMore}>
              {words.clipped(fixed(100 * histogram.clipped_share, 2))}
            </span>
          </>
        )}
      </figcaption>
    </figure>
  );
}

function Steps({ histogram }: { histogram: Histogram }) {
  const { black, between, white } = drawn(histogram);
  const [atBlack, atWhite] = [histogram.black_share, histogram.clipped_share].map((share) =>
    fixed(100 * share, 2),
  );
  return (
    <svg
      viewBox="0 0 1 1"
      preserveAspectRatio="none"
      role="img"
      aria-label={strings.camera.histogramOf(histogram.bits, atBlack ?? "", atWhite ?? "")}
    >
      <path class="between" d={between} />
      <path class="clipped" d={black} />
      <path class="clipped" d={white} />
    </svg>
  );
}
