import { fixed } from "../../words/format";
import {
  AXIS_Y,
  boardInWater,
  boardsAt,
  iris,
  LENS_X,
  opening,
  ringAbout,
  SHELL,
  SIZE,
  type Board,
} from "../../job/set-up-drawing";
import { strings } from "../../strings";
import { length, lengths, type LengthUnit } from "../../words/units";
import type { Setup } from "../../daemon/wire";

interface Props {
  setup: Setup;
  unit: LengthUnit;
  /** Small, it is a sign without words. */
  small?: boolean;
}

/** A drawing of what is to stand before the camera. */
export function SetUpDrawing({ setup, unit, small = false }: Props) {
  return (
    <svg
      class={small ? "set-up small" : "set-up"}
      data-setup={setup.type}
      viewBox={`0 0 ${SIZE.width} ${SIZE.height}`}
      role="img"
      aria-label={told(setup, unit)}
    >
      <Drawing setup={setup} unit={unit} small={small} />
    </svg>
  );
}

/** The same in words. */
function told(setup: Setup, unit: LengthUnit): string {
  const words = strings.setUp.drawing;
  switch (setup.type) {
    case "diffuser":
      return words.diffuser();
    case "boards_in_air": {
      const places = [...new Set(setup.distances_mm)];
      return words.boards_in_air(lengths(places, unit, 1), places.length);
    }
    case "aperture":
      return words.aperture(length(setup.diameter_mm, unit, 2), fixed(setup.ring_f_number, 2));
    case "board_in_water":
      return words.board_in_water(length(setup.distance_mm, unit, 1));
    case "least_e":
      return words.least_e(length(setup.distance_mm, unit, 1));
    case "shell_off":
      return words.shell_off();
  }
}

function Drawing({ setup, unit, small }: Required<Props>) {
  switch (setup.type) {
    case "diffuser":
      return (
        <>
          <path class="light" d={LIGHT} />
          <rect class="diffuser" x={LENS_X - 24} y={AXIS_Y - 36} width={9} height={72} rx={2} />
          <Camera />
          {!small && (
            <text x={LENS_X - 20} y={SIZE.height - 8} text-anchor="middle">
              {strings.setUp.diffuser}
            </text>
          )}
        </>
      );
    case "boards_in_air": {
      const boards = boardsAt(setup.distances_mm);
      return (
        <>
          <Axis />
          <Boards of={boards} />
          <Camera />
          {!small && <Distances of={boards} unit={unit} to={LENS_X} />}
        </>
      );
    }
    case "aperture":
      return <Aperture number={setup.ring_f_number} small={small} />;
    case "board_in_water":
    case "least_e": {
      const board = boardInWater(setup.distance_mm);
      return (
        <>
          <path class="water" d={`M6 14H${SIZE.width}V${AXIS_Y + 44}H6Z`} />
          <path class="level" d={`M6 14q8 -5 16 0${"t16 0".repeat(19)}`} />
          <path class="air" d={housing(SHELL.outer)} />
          <path class="shell" d={housing(SHELL.outer)} />
          <path class="shell" d={housing(SHELL.inner)} />
          <Axis />
          <Boards of={[board]} />
          <Camera />
          {setup.type === "least_e" && (
            <path class="push" d={`M${SIZE.width - 4} 104H${LENS_X}m10 -7l-10 7l10 7`} />
          )}
          {!small && <Distances of={[board]} unit={unit} to={SHELL.vertexX} />}
        </>
      );
    }
    case "shell_off":
      return (
        <>
          <g class="aside">
            <path class="shell" d={dome(SHELL.outer)} />
            <path class="shell" d={dome(SHELL.inner)} />
          </g>
          <path class="push" d={`M${SHELL.vertexX - 10} ${AXIS_Y}l-60 0m10 -7l-10 7l10 7`} />
          <Camera />
        </>
      );
  }
}

const LIGHT = [-28, 0, 28].map((off) => `M40 ${AXIS_Y + off}h120m-9 -6l9 6l-9 6`).join("");

function Axis() {
  return <path class="axis" d={`M8 ${AXIS_Y}H${LENS_X}`} />;
}

/** Lens, microlens array, sensor, and the box about them. */
function Camera() {
  return (
    <>
      <path class="body" d={`M${LENS_X + 6} ${AXIS_Y - 16}h14v-12h58v56h-58v-12h-14z`} />
      <path class="lens" d={`M${LENS_X} ${AXIS_Y - 22}q8 22 0 44q-8 -22 0 -44z`} />
      <path class="mla" d={`M${LENS_X + 56} ${AXIS_Y - 20}v40`} />
      <path class="sensor" d={`M${LENS_X + 66} ${AXIS_Y - 20}v40`} />
    </>
  );
}

/** Half a sphere about the lens, from above to below. */
function dome(radius: number): string {
  return `M${LENS_X} ${AXIS_Y - radius}a${radius} ${radius} 0 0 0 0 ${2 * radius}`;
}

/** The same, closed by the housing that the camera is in, which goes on to the right. */
function housing(radius: number): string {
  return `M${SIZE.width} ${AXIS_Y - radius}H${LENS_X}a${radius} ${radius} 0 0 0 0 ${2 * radius}H${SIZE.width}`;
}

function Boards({ of }: { of: Board[] }) {
  return (
    <>
      {of.map(({ x, top, bottom }) => (
        <path key={x} class="board" d={`M${x} ${top}V${bottom}`} />
      ))}
      {of.slice(1).map((board, n) => (
        <path key={board.x} class="tread" d={`M${of[n]?.x ?? board.x} ${board.bottom}H${board.x}`} />
      ))}
    </>
  );
}

interface DistancesProps {
  of: Board[];
  unit: LengthUnit;
  /** What they are measured from. */
  to: number;
}

/** A line below the drawing for each board's distance, the nearest lowest; the lengths above all lines, which they interrupt. */
function Distances({ of, unit, to }: DistancesProps) {
  const lines = of.map((board, row) => ({ ...board, y: SIZE.height - 6 - row * 9 }));
  // Side by side: several would lie over each other.
  const along = (row: number) => (of.length > 1 ? 0.82 - 0.27 * row : 0.5);
  return (
    <>
      {lines.map(({ x, bottom, y }) => (
        <path
          key={y}
          class="distance"
          d={`M${x} ${bottom + 2}V${y + 3}M${x} ${y}H${to}M${to} ${AXIS_Y + 24}V${y + 3}`}
        />
      ))}
      {lines.map(({ x, y, distanceMm }, row) => (
        <text key={y} x={x + (to - x) * along(row)} y={y + 4} text-anchor="middle">
          {length(distanceMm, unit, 1)}
        </text>
      ))}
    </>
  );
}

function Aperture({ number, small }: { number: number; small: boolean }) {
  const middle = SIZE.width / 2;
  const y = small ? SIZE.height / 2 : 42;
  const rim = small ? 50 : 34;
  return (
    <>
      <circle class="rim" cx={middle} cy={y} r={rim} />
      <polygon class="iris" points={iris(middle, y, rim * opening(number))} />
      {!small && (
        <>
          <path class="pointer" d={`M${middle} 92l-5 -8h10z`} />
          <path class="ring" d={`M${middle - 110} 94H${middle + 110}`} />
          {ringAbout(number).map(({ x, stop }) => (
            <g key={stop}>
              <path class="ring" d={`M${x} 94v6`} />
              <text x={x} y={113} text-anchor="middle">
                {String(stop)}
              </text>
            </g>
          ))}
        </>
      )}
    </>
  );
}
