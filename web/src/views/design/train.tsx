import { useEffect, useRef, useState } from "preact/hooks";
import { valueAt, type JsonObject } from "../../design/config-schema";
import {
  barLength,
  boxOf,
  fitted,
  hemisphere,
  PARTS,
  trainOf,
  type Box,
  type Part,
  type Train,
} from "../../design/optical-train";
import { strings } from "../../strings";
import { trainLabels } from "../../design/train-labels";
import { length, signedLength, type LengthUnit } from "../../words/units";
import type { Draft, DraftState, DraftStateName } from "../../daemon/wire";
import { Choice } from "../toggle";
import type { Other } from "./figures";

/** Height of the letters, in those of the page. */
const LETTERS = 0.8;
const RAYS = 9;

interface Props {
  draft: Draft;
  other: Other | null;
  unit: LengthUnit;
}

/** The optical train to scale, and another's beside it. */
export function Drawings({ draft, other, unit }: Props) {
  const [part, see] = useState<Part>("camera");
  const [name, draw] = useState<DraftStateName>("joint");
  const words = strings.design;
  const drawings = [{ title: other ? words.yours : null, of: draft }];
  if (other) drawings.push({ title: other.name, of: other.draft });
  return (
    <section class="card drawings" aria-label={words.drawing}>
      <h2>{words.drawing}</h2>
      <p class="row">
        <Choice
          label={words.stateLabel}
          of={draft.states.map(({ state }) => state)}
          chosen={name}
          name={(state) => words.state[state]}
          choose={draw}
        />
        <Choice
          label={words.viewLabel}
          of={PARTS}
          chosen={part}
          name={(one) => words.view[one]}
          choose={see}
        />
      </p>
      <div class={other && part !== "scene" ? "side-by-side" : ""}>
        {drawings.map(({ title, of }) => {
          const state = of.states.find(({ state }) => state === name);
          return state && <Drawing key={title ?? ""} {...{ title, of, state, part, unit }} />;
        })}
      </div>
    </section>
  );
}

interface DrawingProps {
  title: string | null;
  of: Draft;
  state: DraftState;
  part: Part;
  unit: LengthUnit;
}

function Drawing({ title, of, state, part, unit }: DrawingProps) {
  const words = strings.design;
  const config = of.config as JsonObject;
  const at = (path: string) => Number(valueAt(config, path));
  const train = trainOf(state, {
    outerRadius: at("shell.outer_radius_mm"),
    innerRadius: at("shell.inner_radius_mm"),
    pitch: at("mla.pitch_mm"),
    b: of.design.mla.b_mm,
    sensorWidth: (at("sensor.width_px") * at("sensor.pixel_um")) / 1000,
    objectDistance: at(state.state === "reference" ? "object.air_distance_mm" : "object.distance_mm"),
  });
  const e = typeof state.e_mm === "number" ? words.drawnE(length(state.e_mm, unit, 2)) : "";
  const lost = RAYS - train.rays.length;
  return (
    <figure>
      <Picture
        train={train}
        wanted={boxOf(train, part)}
        part={part}
        unit={unit}
        label={words.drawingLabel(words.state[state.state], words.view[part])}
      />
      <figcaption class="facts">
        {title && <b>{title}</b>}
        <span>{words.drawn(words.state[state.state], e, signedLength(state.delta_v_mm, unit, 3))}</span>
        {lost === RAYS ? <span class="fault">{words.raysNone}</span> : null}
        {lost > 0 && lost < RAYS ? <span class="fault">{words.raysLost(lost)}</span> : null}
      </figcaption>
    </figure>
  );
}

interface PictureProps {
  train: Train;
  wanted: Box;
  part: Part;
  unit: LengthUnit;
  label: string;
}

function Picture({ train, wanted, part, unit, label }: PictureProps) {
  const svg = useRef<SVGSVGElement>(null);
  const [shown, setShown] = useState({ width: 600, height: 300, letters: 12 });
  useEffect(() => {
    const element = svg.current;
    if (!element) return undefined;
    const resize = new ResizeObserver(() => {
      const { clientWidth: width, clientHeight: height } = element;
      const letters = LETTERS * parseFloat(getComputedStyle(document.documentElement).fontSize);
      if (width > 0 && height > 0) setShown({ width, height, letters });
    });
    resize.observe(element);
    return () => resize.disconnect();
  }, []);
  const box = fitted(wanted, shown.width / shown.height);
  const letter = (shown.letters * box.width) / shown.width;
  const bar = barLength(box.width);
  const bottom = box.y + box.height;
  return (
    <svg
      ref={svg}
      class="train"
      data-part={part}
      viewBox={`${box.x} ${box.y} ${box.width} ${box.height}`}
      role="img"
      aria-label={label}
      style={{ fontSize: `${letter}px` }}
    >
      <Shell train={train} box={box} letter={letter} part={part} />
      <line class="axis" x1={box.x} y1={0} x2={box.x + box.width} y2={0} />
      {train.rays
        .filter(({ field }) => part !== "mla" || field === 0)
        .map(({ field, points }, index) => (
          <polyline key={index} class="ray" data-field={field} points={points} />
        ))}
      <Camera train={train} part={part} />
      {trainLabels(train, part, box, letter, bar + letter).map(({ text, x, y, anchor }) => (
        <text key={text} class="label" x={x} y={y} text-anchor={anchor}>
          {text}
        </text>
      ))}
      <g class="bar">
        <line x1={box.x + letter} y1={bottom - letter} x2={box.x + letter + bar} y2={bottom - letter} />
        <text x={box.x + letter} y={bottom - 1.5 * letter}>
          {length(bar, unit, Math.max(0, -Math.floor(Math.log10(bar))))}
        </text>
      </g>
    </svg>
  );
}

/** Water, shell and the air within, where there is a shell. */
function Shell({ train, box, letter, part }: { train: Train; box: Box; letter: number; part: Part }) {
  const { centre, outerRadius, innerRadius } = train;
  if (centre === null || part === "mla") return null;
  return (
    <>
      <rect class="water" x={box.x} y={box.y} width={Math.max(0, centre - box.x)} height={box.height} />
      <path class="glass" d={`${hemisphere(centre, outerRadius)}Z`} />
      <path class="within" d={`${hemisphere(centre, innerRadius)}Z`} />
      <path class="edge" d={hemisphere(centre, outerRadius)} />
      <path class="edge" d={hemisphere(centre, innerRadius)} />
      {part === "camera" && (
        <path class="mark" d={`M${centre - letter / 2} 0h${letter}M${centre} ${-letter / 2}v${letter}`} />
      )}
    </>
  );
}

/** Board, main lens, MLA and sensor. */
function Camera({ train, part }: { train: Train; part: Part }) {
  const { aperture, mla, sensor, sensorWidth, boardWidth, object, pitch } = train;
  const half = sensorWidth / 2;
  if (part === "mla") {
    return (
      <>
        <Microlenses at={mla} pitch={pitch} half={half} />
        <line class="sensor" x1={sensor} y1={-half} x2={sensor} y2={half} />
      </>
    );
  }
  const stop = aperture * 0.75;
  return (
    <>
      {boardWidth !== null && (
        <line class="board" x1={object} y1={-boardWidth / 2} x2={object} y2={boardWidth / 2} />
      )}
      <path class="stop" d={`M0 ${-aperture / 2}V${-stop}M0 ${aperture / 2}V${stop}`} />
      <path class="lens" d={lens(aperture)} />
      <line class="mla" x1={mla} y1={-half} x2={mla} y2={half} />
      <line class="sensor" x1={sensor} y1={-half} x2={sensor} y2={half} />
    </>
  );
}

/** A biconvex lens as high as the aperture. */
function lens(aperture: number): string {
  const half = aperture / 2;
  const bulge = aperture / 5;
  return `M0 ${-half}Q${bulge} 0 0 ${half}Q${-bulge} 0 0 ${-half}Z`;
}

/** As many microlenses as are near the axis. */
function Microlenses({ at, pitch, half }: { at: number; pitch: number; half: number }) {
  const count = Math.min(9, Math.floor(half / pitch));
  const places = Array.from({ length: 2 * count + 1 }, (_, index) => (index - count) * pitch);
  const edge = pitch / 2;
  const bulge = pitch / 4;
  return (
    <>
      {places.map((y) => (
        <path
          key={y}
          class="lens"
          d={`M${at} ${y - edge}Q${at + bulge} ${y} ${at} ${y + edge}Q${at - bulge} ${y} ${at} ${y - edge}Z`}
        />
      ))}
    </>
  );
}
