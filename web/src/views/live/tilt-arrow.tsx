import { octant, type Tilt } from "../../correction";
import { strings } from "../../strings";
import { angle } from "../../units";

/** Where the spacing grows over the field, and the angle that would be. */
export function TiltArrow({ tilt }: { tilt: Tilt }) {
  const where = strings.meter.tiltMore(strings.meter.octant[octant(tilt.towards)]);
  return (
    <div class="tilt" title={strings.meter.tiltCaution}>
      <svg viewBox="-24 -24 48 48" width="48" height="48" aria-hidden="true">
        <circle r="22" fill="none" stroke="currentColor" stroke-width="1.5" opacity="0.4" />
        <g transform={`rotate(${((tilt.towards * 180) / Math.PI).toFixed(0)})`}>
          <path d="M-16 0H10M3 -7L12 0L3 7" fill="none" stroke="currentColor" stroke-width="4" />
        </g>
      </svg>
      <p>
        <b>{strings.meter.tilt(angle(tilt.degrees, 2))}</b>
        <br />
        <span class="quiet">{where}</span>
      </p>
    </div>
  );
}
