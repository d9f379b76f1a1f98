import { degrees } from "../../design/draft";
import { strings } from "../../strings";
import { length, signedLength, type LengthUnit } from "../../words/units";
import type { Draft } from "../../daemon/wire";
import { Explained } from "../term";

interface Props {
  draft: Draft;
  unit: LengthUnit;
  /** What the fields say is no camera. */
  wrong: boolean;
  /** What is shown is not what the fields say, or may not be. */
  stale: boolean;
  /** Where the rest of the results is. */
  results: string;
}

/** What a draft comes to in short, in sight of the fields where the results are below them. */
export function Summary({ draft, unit, wrong, stale, results }: Props) {
  const words = strings.design;
  const joint = draft.states.find(({ state }) => state === "joint");
  if (!joint) return null;
  const figures: [string, string][] = [
    [words.figure.deltaV, signedLength(joint.delta_v_mm, unit, 3)],
    [words.figure.e, typeof joint.e_mm === "number" ? length(joint.e_mm, unit, 2) : words.none],
    [words.figure.aperture, length(joint.aperture_mm, unit, 3)],
    [words.figure.fovShort, degrees(joint.fov_deg) ?? words.cut],
  ];
  const show = () => {
    const place = document.getElementById(results);
    place?.focus({ preventScroll: true });
    place?.scrollIntoView();
  };
  return (
    <section class="summary" data-stale={stale} aria-label={words.inShort}>
      <dl>
        {figures.map(([name, value]) => (
          <div key={name}>
            <dt>
              <Explained text={name} />
            </dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
      <p class="row">
        <span class="quiet">{wrong ? words.inShortOld : words.inShortMore}</span>
        <button type="button" onClick={show}>
          {words.allResults}
        </button>
      </p>
    </section>
  );
}
