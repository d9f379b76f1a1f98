// Says now and then what a region of the picture says for itself.

import type { Context } from "./overlay";
import type { Region } from "./marks";
import { greyOf, spacingIn, type Grey, type RegionSpacing } from "./region";
import type { FieldMap, Part } from "../daemon/wire";

export interface RegionFacts {
  /** Null where nothing was measured there. */
  spacing: RegionSpacing | null;
  /** Null until the picture has every pixel of it. */
  grey: Grey | null;
}

/** From one look to the next at least, ms; and how many times what one took. */
const REST_MS = 250;
const REST = 5;

export class RegionWatch {
  private region: Region | null = null;
  private facts: RegionFacts | null = null;
  private lookedAt = -Infinity;
  private tookMs = 0;
  private context: Context | null = null;

  constructor(private readonly say: (facts: RegionFacts | null) => void) {}

  /** Looks at this one from now on. */
  of(region: Region | null, map: FieldMap | null): void {
    if (region === this.region) return;
    this.region = region;
    this.lookedAt = -Infinity;
    this.facts = region && { spacing: map && spacingIn(map, region), grey: null };
    this.say(this.facts);
  }

  /** The spacing has been measured anew. */
  measured(map: FieldMap | null): void {
    if (!this.region || !this.facts) return;
    this.facts = { ...this.facts, spacing: map && spacingIn(map, this.region) };
    this.say(this.facts);
  }

  /** A picture that has every pixel of `part`. */
  look(bitmap: ImageBitmap, part: Part, now: number): void {
    const { region, facts } = this;
    if (!region || !facts || !covers(part, region)) return;
    if (now - this.lookedAt < Math.max(REST_MS, REST * this.tookMs)) return;
    this.lookedAt = now;
    const { x, y, width, height } = region;
    const context = (this.context ??= surface());
    if (!context) return;
    context.canvas.width = width;
    context.canvas.height = height;
    context.drawImage(bitmap, x - part.x_px, y - part.y_px, width, height, 0, 0, width, height);
    this.facts = { ...facts, grey: greyOf(context.getImageData(0, 0, width, height).data) };
    this.tookMs = performance.now() - now;
    this.say(this.facts);
  }
}

/** Whether a picture of a part shows all of a region. */
export function covers(part: Part, { x, y, width, height }: Region): boolean {
  return (
    x >= part.x_px &&
    y >= part.y_px &&
    x + width <= part.x_px + part.width_px &&
    y + height <= part.y_px + part.height_px
  );
}

/** A canvas that is read. */
function surface(): Context | null {
  const canvas =
    typeof OffscreenCanvas === "undefined" ? document.createElement("canvas") : new OffscreenCanvas(1, 1);
  return canvas.getContext("2d", { willReadFrequently: true }) as Context | null;
}
