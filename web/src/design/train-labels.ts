// The words of the optical train's drawing, and where they may stand.

import { placed, type Label, type Placed, type Spot } from "./labels";
import type { Box, Part, Train } from "./optical-train";
import { strings } from "../strings";

/** What the scale's bar takes of the lower left corner, letters. */
const BAR = 3;

/** A label above or below a place of the axis, at the least distance `off` from it and then further out. */
function about(x: number, off: number, letter: number, anchors: Spot["anchor"][], first: -1 | 1): Spot[] {
  const rows = [0, 1.3, 2.6];
  return rows.flatMap((row) =>
    [first, -first].flatMap((side) =>
      anchors.map((anchor) => {
        const shift = { start: 0.4, middle: 0, end: -0.4 }[anchor] * letter;
        const away = off + (row + (side < 0 ? 0.5 : 1.2)) * letter;
        return { x: x + shift, y: side * away, anchor };
      }),
    ),
  );
}

/** What is named in a part of the train, none of it over another. */
export function trainLabels(train: Train, part: Part, box: Box, letter: number, bar: number): Placed[] {
  const words = strings.design.parts;
  const { aperture, mla, sensor, sensorWidth, boardWidth, object, centre } = train;
  const half = sensorWidth / 2;
  const stop = 0.75 * aperture;
  const top = box.y + 1.4 * letter;
  const right = box.x + box.width - 0.4 * letter;
  const labels: Label[] = [];
  // The bar, and the optical elements.
  const taken: Box[] = [
    {
      x: box.x,
      y: box.y + box.height - BAR * letter,
      width: Math.max(bar, 6 * letter),
      height: BAR * letter,
    },
  ];
  if (part === "mla") {
    const over: Spot[] = [top, top + 1.3 * letter].flatMap((y) =>
      (["middle", "end"] as const).map((anchor) => ({ x: mla, y, anchor })),
    );
    labels.push({ text: words.mla, spots: over });
    labels.push({
      text: words.sensor,
      spots: [top, top + 1.3 * letter].flatMap((y): Spot[] => [
        { x: sensor + 0.6 * letter, y, anchor: "start" },
        { x: sensor - 0.6 * letter, y, anchor: "end" },
      ]),
    });
    return placed(labels, letter, box, taken);
  }
  taken.push({ x: -letter / 4, y: -stop, width: letter / 2, height: 2 * stop });
  taken.push({ x: mla, y: -half, width: sensor - mla, height: 2 * half });
  if (part === "camera") {
    labels.push({ text: words.lens, spots: about(0, stop, letter, ["middle", "start", "end"], -1) });
    const below: Spot[] = [1.2, 2.5, 3.8].map((row) => ({ x: right, y: half + row * letter, anchor: "end" }));
    labels.push({ text: words.mlaAndSensor, spots: below });
    if (centre !== null) {
      const off = Math.max(letter / 2, Math.abs(centre) < 2 * letter ? stop : 0);
      labels.push({ text: words.centre, spots: about(centre, off, letter, ["end", "middle", "start"], 1) });
    }
  } else if (boardWidth !== null) {
    taken.push({ x: object, y: -boardWidth / 2, width: letter / 4, height: boardWidth });
    const along = [-boardWidth / 2 + letter, boardWidth / 2 - letter / 2, -2 * letter, 3 * letter];
    labels.push({
      text: words.board,
      spots: along.flatMap((y): Spot[] => [
        { x: object + letter / 2, y, anchor: "start" },
        { x: object - letter / 2, y, anchor: "end" },
      ]),
    });
  }
  if (centre !== null) {
    labels.push({
      text: words.water,
      spots: [box.x + letter, box.x + 5 * letter].map((x) => ({ x, y: top, anchor: "start" })),
    });
  }
  return placed(labels, letter, box, taken);
}
