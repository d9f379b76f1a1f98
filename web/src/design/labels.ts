// Where the words of a drawing go: each at the first of its places that is free.

import type { Box } from "./optical-train";

/** The share of a letter's height that it takes in width, on average and a little more. */
const WIDTH = 0.62;
/** Of a letter's height: above and below the line that it stands on. */
const [ABOVE, BELOW] = [0.9, 0.3];

/** A place for a label: the point that it begins, ends or is centred at, on the line that it stands on. */
export interface Spot {
  x: number;
  y: number;
  anchor: "start" | "middle" | "end";
}

export interface Label {
  text: string;
  /** The best first. */
  spots: Spot[];
}

export interface Placed extends Spot {
  text: string;
}

function boxOf(text: string, { x, y, anchor }: Spot, letter: number): Box {
  const width = WIDTH * letter * text.length;
  const before = { start: 0, middle: width / 2, end: width }[anchor];
  return { x: x - before, y: y - ABOVE * letter, width, height: (ABOVE + BELOW) * letter };
}

function overlap(one: Box, other: Box): boolean {
  return (
    one.x < other.x + other.width &&
    other.x < one.x + one.width &&
    one.y < other.y + other.height &&
    other.y < one.y + one.height
  );
}

function inside(box: Box, within: Box): boolean {
  return (
    box.x >= within.x &&
    box.y >= within.y &&
    box.x + box.width <= within.x + within.width &&
    box.y + box.height <= within.y + within.height
  );
}

/** Labels with letters of that height, the more important ones first; one that has no free place is left out. */
export function placed(labels: Label[], letter: number, within: Box, taken: Box[]): Placed[] {
  const full = [...taken];
  return labels.flatMap(({ text, spots }) => {
    for (const spot of spots) {
      const box = boxOf(text, spot, letter);
      if (!inside(box, within) || full.some((other) => overlap(box, other))) continue;
      full.push(box);
      return [{ text, ...spot }];
    }
    return [];
  });
}
