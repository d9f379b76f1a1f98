// Measuring in the raw frame that is seen: what is marked in it, by pointer or by keys, and what a region says. As what one
// looks through, it is outside the page's state.

import {
  fitting,
  movedRegion,
  movedRuler,
  noMarks,
  regionOf,
  resizedRegion,
  rulerOf,
  type Marks,
  type Place,
  type Tool,
} from "./marks";
import type { RegionFacts } from "./region-watch";
import type { Size, Viewport } from "./viewport";

/** What is seen of a frame. */
export interface Seen {
  viewport: Viewport;
  view: Size;
  frame: Size;
}

/** Where what is drawn by a tool begins and ends at first, shares of the view. */
const AT_FIRST = [0.375, 0.625] as const;

export class Marking {
  private drawn = noMarks;
  private using: Tool | null = null;
  private facts: RegionFacts | null = null;

  /** `seen` says what is seen of the raw frame, in CSS pixels; null while none is shown. `changed` is told of other marks. */
  constructor(
    private readonly seen: () => Seen | null,
    private readonly changed: (marks: Marks) => void,
  ) {}

  get marks(): Marks {
    return this.drawn;
  }

  /** What a drag draws; null where it moves the picture. */
  get tool(): Tool | null {
    return this.using;
  }

  /** What the region marked says; null where there is none. */
  get region(): RegionFacts | null {
    return this.facts;
  }

  /** What the region says now. */
  heed(facts: RegionFacts | null): void {
    this.facts = this.drawn.region ? facts : null;
  }

  /** Has a drag draw something from now on, which is in the middle of what is seen at first; or has it draw nothing, and
   *  nothing measured. */
  use(tool: Tool | null): void {
    const seen = this.seen();
    this.using = seen && tool;
    this.mark({ ...noMarks, crosshair: this.drawn.crosshair });
    if (!seen) return;
    const { width, height } = seen.view;
    const [one, other] = AT_FIRST.map((share) => this.pixel({ x: share * width, y: share * height }));
    if (one && other) this.draw(one, tool === "ruler" ? { x: other.x, y: one.y } : other);
  }

  showCrosshair(crosshair: boolean): void {
    this.mark({ ...this.drawn, crosshair });
  }

  /** Draws from one pixel to another with the tool in use. */
  draw(from: Place, to: Place): void {
    const frame = this.seen()?.frame;
    if (!frame || this.using === null) return;
    const next =
      this.using === "region" ? { region: regionOf(from, to, frame) } : { ruler: rulerOf(from, to, frame) };
    this.mark({ ...this.drawn, ...next });
  }

  /** Moves what is drawn, or the other end of it, by so many pixels of the view: one of the frame at least. */
  shift(dx: number, dy: number, otherEnd: boolean): void {
    const seen = this.seen();
    if (!seen) return;
    const step = (pixels: number) =>
      Math.sign(pixels) * Math.max(1, Math.round(Math.abs(pixels) / seen.viewport.scale));
    const by = { x: step(dx), y: step(dy) };
    const { region, ruler } = this.drawn;
    this.mark({
      ...this.drawn,
      region: region && (otherEnd ? resizedRegion : movedRegion)(region, by, seen.frame),
      ruler: ruler && movedRuler(ruler, otherEnd ? "from" : "to", by, seen.frame),
    });
  }

  /** The raw pixel at a place of the view, or the nearest one; null where no raw frame is shown. */
  pixel(at: Place): Place | null {
    const seen = this.seen();
    if (!seen) return null;
    const { left, top, scale } = seen.viewport;
    const held = (value: number, count: number) => Math.min(Math.max(Math.floor(value), 0), count - 1);
    return {
      x: held((at.x - left) / scale, seen.frame.width),
      y: held((at.y - top) / scale, seen.frame.height),
    };
  }

  /** What is marked outside of a frame is no more: another one may be smaller. */
  keepWithin(frame: Size): void {
    const next = fitting(this.drawn, frame);
    if (next !== this.drawn) this.mark(next);
  }

  forget(): void {
    this.using = null;
    this.mark(noMarks);
  }

  private mark(marks: Marks): void {
    if (marks === this.drawn) return;
    this.drawn = marks;
    if (marks.region === null) this.facts = null;
    this.changed(marks);
  }
}
