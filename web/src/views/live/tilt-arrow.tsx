import { octant, type Tilt } from "../../meter/correction";
import { strings } from "../../strings";
import { angle } from "../../words/units";

/** A tilt of fewer standard uncertainties is none: no arrow points where noise does. */
const SIGMAS = 3;

/** Where the spacing grows over the field, and the angle that would be. */
export function TiltArrow({ tilt }: { tilt: Tilt }) {
  const told = tilt.degrees > SIGMAS * tilt.sigmaDegrees;
  const words = strings.meter;
  const where = told ? words.tiltMore(words.octant[octant(tilt.towards)]) : words.tiltNone;
  return (
    <div class="tilt" title={strings.meter.tiltCaution}>
      <svg viewBox="-24 -24 48 48" width="48" height="48" aria-hidden="true">
        <circle r="22" fill="none" stroke="currentColor" stroke-width="1.5" opacity="0.4" />
        {told && (
          <g transform={`rotate(${((tilt.towards * 180) / Math.PI).toFixed(0)})`}>
            <path d="M-16 0H10M3 -7L12 0L3 7" fill="none" stroke="currentColor" stroke-width="4" />
          </g>
        )}
      </svg>
      <p>
        <b>{words.tilt(told ? angle(tilt.degrees, 2) : words.below(angle(SIGMAS * tilt.sigmaDegrees, 2)))}</b>
        <br />
        <span class="quiet">{where}</span>
      </p>
    </div>
  );
}

/** In its place where what is before the lens would be taken for a tilt. */
export function TiltUntold({ why }: { why: string }) {
  return (
    <div class="tilt">
      <p>
        <b>{strings.meter.tiltUntold}</b>
        <br />
        <span class="quiet">{why}</span>
      </p>
    </div>
  );
}
