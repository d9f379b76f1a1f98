// Draws the newest picture and what is laid over it, on canvases of a window or of a worker alike. What is seen of it is
// decided elsewhere.

import { COARSE, EVERY, partSeen, SINGLE, type Aim } from "../daemon/aim";
import { pairs } from "./field-map";
import { linesOf, surfaceOf, type Line } from "./field-surface";
import { noMarks, type Marks } from "./marks";
import { drawMarks } from "./marks-drawn";
import { drawError, drawGrid, drawLines, drawPairs, type Context } from "./overlay";
import type { Overlay } from "../preferences";
import { covers, RegionWatch, type RegionFacts } from "./region-watch";
import { SaturationWatch } from "./saturation-watch";
import { onFrame } from "./screen-frame";
import { extent } from "./show";
import { fit, pan, type Size, type Viewport } from "./viewport";
import type { FieldMap, Lens, Part, Picture, PictureFacts, Show } from "../daemon/wire";

export type Surface = HTMLCanvasElement | OffscreenCanvas;

/** What is seen of the picture. */
export interface Look {
  /** The canvas, in pixels of the screen. */
  view: Size;
  /** Pixels of the screen to a CSS pixel. */
  ratio: number;
  /** Null while the whole of it is shown. */
  viewport: Viewport | null;
  /** What it counts in: it says nothing about a picture of something else. */
  show: Show;
}

/** What is written on a picture that is kept, where it is so. */
export interface Stamps {
  simulated: string;
  replayed: string;
  /** What the ends of a depth map's colours stand for, and its stripes. */
  depth: { far: string; near: string; unknown: string };
}

/** The ends of a depth map's colours. */
const [FAR, NEAR] = ["#440154", "#fde725"];
/** How high the line below a depth map is that says so, CSS px. */
const LEGEND_PX = 24;

/** What was seen, and of which frame it is. */
export interface Taken {
  file: Blob;
  facts: PictureFacts;
}

export class Painter {
  private canvas: Surface | null = null;
  private over: Surface | null = null;
  private bitmap: ImageBitmap | null = null;
  private facts: PictureFacts | null = null;
  /** The whole frame as it was seen last: it stands where a part of it does not reach, until the next one does. */
  private behind: ImageBitmap | null = null;
  private map: FieldMap | null = null;
  private links: [Lens, Lens][] = [];
  private lines: Line[] = [];
  private overlays: Overlay[] = [];
  private marks: Marks = noMarks;
  private look: Look | null = null;
  private readonly saturated: SaturationWatch;
  private readonly region: RegionWatch;
  private due = false;
  private dueOver = false;
  private probing: Context | null = null;
  /** How many times everything was forgotten: what was being decoded then is for nobody. */
  private forgotten = 0;

  /** `saturation` is told the share of the pixels that are saturated, `region` what a region says; null while nobody asks. */
  constructor(saturation: (share: number | null) => void, region: (facts: RegionFacts | null) => void) {
    this.region = new RegionWatch(region);
    this.saturated = new SaturationWatch(() => {
      saturation(this.saturated.newest?.share ?? null);
      this.soon(true);
    });
  }

  /** Draws on these from now on. */
  attach(canvas: Surface, over: Surface): void {
    this.canvas = canvas;
    this.over = over;
    this.soon(true);
  }

  detach(): void {
    this.canvas = this.over = null;
  }

  /** Draws a picture unless a newer one is shown already; the picture's own size, or null where it is not shown. */
  async show(picture: Picture): Promise<Size | null> {
    const { forgotten } = this;
    let bitmap: ImageBitmap;
    try {
      bitmap = await createImageBitmap(picture.file);
    } catch {
      return null;
    }
    const other = this.facts !== null && picture.facts.show !== this.facts.show;
    // A view is ready later than the raw frame that it is made of: when they change it is older, and shown all the same.
    const older = this.facts && this.bitmap && !other && picture.facts.capturedAt < this.facts.capturedAt;
    if (older || forgotten !== this.forgotten) {
      bitmap.close();
      return null;
    }
    this.putAway(picture.facts);
    this.bitmap = bitmap;
    this.facts = picture.facts;
    if (other) this.saturated.forget();
    // What is laid over is drawn anew when it is known anew, not with each picture.
    const { part } = picture.facts;
    if (this.overlays.includes("saturation") && part && hasEvery(part) && isWhole(picture.facts)) {
      this.saturated.look(picture.file, performance.now());
    }
    if (part && hasEvery(part)) this.region.look(bitmap, part, performance.now());
    this.drawPicture();
    if (other) this.soon(true);
    return { width: bitmap.width, height: bitmap.height };
  }

  /** Nothing of it is left for the next one who looks. */
  forget(): void {
    this.forgotten += 1;
    this.putAway(null);
    this.bitmap = this.facts = null;
    this.saturated.forget();
    this.forgetMap();
  }

  /** Draws no map until there is another: what the one measured is before the lens no more. */
  forgetMap(): void {
    this.map = null;
    this.links = [];
    this.lines = [];
    this.region.measured(null);
    this.soon(true);
  }

  /** Shows it; how far its lines of equal spacing are apart, px, or null where it has none. */
  showMap(map: FieldMap): number | null {
    this.map = map;
    this.links = pairs(map);
    const surface = surfaceOf(map);
    this.lines = surface ? linesOf(surface) : [];
    this.region.measured(map);
    this.soon(true);
    return surface?.stepPx ?? null;
  }

  showOverlays(overlays: Overlay[]): void {
    this.overlays = overlays;
    if (!overlays.includes("saturation")) this.saturated.forget();
    this.soon(true);
  }

  showMarks(marks: Marks): void {
    this.marks = marks;
    this.region.of(marks.region, this.map);
    this.soon(true);
  }

  lookAt(look: Look): void {
    this.look = look;
    this.soon(true);
  }

  /** The grey level of a raw pixel; null where the picture shown does not have it. */
  grey(x: number, y: number): number | null {
    const part = this.facts?.part;
    if (!this.bitmap || !part || !hasEvery(part)) return null;
    const [column, row] = [x - part.x_px, y - part.y_px];
    if (column < 0 || row < 0 || column >= part.width_px || row >= part.height_px) return null;
    const one = (this.probing ??= surface(1));
    one?.drawImage(this.bitmap, column, row, 1, 1, 0, 0, 1, 1);
    return one?.getImageData(0, 0, 1, 1).data[0] ?? null;
  }

  /** What is seen, with what is laid over it, as a PNG; null where nothing is shown. */
  async snapshot(stamps: Stamps): Promise<Taken | null> {
    const { canvas, over, facts } = this;
    const seen = this.seen();
    if (!canvas || !over || !facts || !seen) return null;
    const { width, height } = seen.frame;
    const { left, top, scale } = seen.viewport;
    // What is beside the frame is left out.
    const [x, y] = [Math.max(0, Math.round(left)), Math.max(0, Math.round(top))];
    const right = Math.min(seen.view.width, Math.round(left + width * scale));
    const bottom = Math.min(seen.view.height, Math.round(top + height * scale));
    // As it is drawn now: what is asked for may be drawn only with the next frame.
    this.drawPicture();
    this.drawOver();
    const ratio = this.look?.ratio ?? 1;
    const size = { width: Math.max(1, right - x), height: Math.max(1, bottom - y) };
    const legend = facts.show === "depth" ? LEGEND_PX * ratio : 0;
    const file = await fileOf(size.width, size.height + legend, (context) => {
      if (legend > 0) drawLegend(context, stamps.depth, size, ratio);
      context.drawImage(canvas, -x, -y);
      context.drawImage(over, -x, -y);
      const words = [facts.simulated && stamps.simulated, facts.replayed && stamps.replayed];
      drawStamp(context, words.filter(Boolean).join(" · "), ratio);
    });
    return file && { file, facts };
  }

  /** What is to be sent of the raw frame. */
  aim(): Aim {
    const seen = this.canvas && this.seen();
    if (!seen || this.facts?.show !== "raw") return COARSE;
    // A mean over several pixels does not say whether one of them is saturated.
    if (this.overlays.includes("saturation")) return EVERY;
    const part = partSeen(seen.viewport, seen.view, seen.frame);
    // Nor does it say how bright a region is at its brightest.
    const { region } = this.marks;
    return region && !(hasEvery(part) && covers(part, region)) ? EVERY : { viewport: part };
  }

  /** Puts the picture away: behind the next one, where that is a part of what it shows the whole of. */
  private putAway(next: PictureFacts | null): void {
    const { bitmap, behind } = this;
    const covered = !next?.part || isWhole(next);
    this.behind = covered ? null : this.facts && isWhole(this.facts) ? bitmap : behind;
    for (const gone of [bitmap, behind]) if (gone !== this.behind) gone?.close();
  }

  private seen(): { viewport: Viewport; view: Size; frame: Size } | null {
    const { bitmap, facts, look } = this;
    if (!look || !facts || !bitmap || look.view.width === 0 || look.view.height === 0) return null;
    const frame = extent(facts, bitmap);
    const viewport =
      look.viewport && look.show === facts.show
        ? // Another size of the view or of the frame: kept in sight.
          pan(look.viewport, 0, 0, look.view, frame)
        : fit(look.view, frame);
    return { viewport, view: look.view, frame };
  }

  private soon(over: boolean): void {
    this.dueOver ||= over;
    if (this.due) return;
    this.due = true;
    onFrame(() => {
      this.due = false;
      this.drawPicture();
      if (this.dueOver) this.drawOver();
      this.dueOver = false;
    });
  }

  private drawPicture(): void {
    const seen = this.seen();
    const context = begin(this.canvas, seen?.view, { alpha: false });
    if (!seen || !context || !this.bitmap) return;
    const { scale, left, top } = seen.viewport;
    const { width, height } = seen.frame;
    if (this.behind) context.drawImage(this.behind, left, top, width * scale, height * scale);
    context.imageSmoothingEnabled = scale < SINGLE;
    const part = this.facts?.part ?? { x_px: 0, y_px: 0, width_px: width, height_px: height };
    const [x, y] = [left + part.x_px * scale, top + part.y_px * scale];
    context.drawImage(this.bitmap, x, y, part.width_px * scale, part.height_px * scale);
  }

  private drawOver(): void {
    const seen = this.seen();
    const context = begin(this.over, seen?.view);
    if (!seen || !context) return;
    const { scale, left, top } = seen.viewport;
    // Centres are at the middle of pixels.
    context.setTransform(scale, 0, 0, scale, left + scale / 2, top + scale / 2);
    context.lineWidth = (1.4 * (this.look?.ratio ?? 1)) / scale;
    if (this.overlays.includes("saturation")) this.drawSaturation(context, seen.frame);
    this.drawMap(context);
    if (this.facts?.show === "raw") drawMarks(context, this.marks, seen.frame);
  }

  private drawMap(context: Context): void {
    const map = this.map;
    if (!map) return;
    if (this.overlays.includes("error")) {
      drawError(context, map);
      drawLines(context, this.lines);
    }
    if (this.overlays.includes("pairs")) drawPairs(context, this.links);
    if (this.overlays.includes("grid")) drawGrid(context, map);
  }

  private drawSaturation(context: Context, frame: Size): void {
    const found = this.saturated.newest;
    if (!found) return;
    context.imageSmoothingEnabled = false;
    context.drawImage(found.mask, -0.5, -0.5, frame.width, frame.height);
  }
}

/** Whether a picture shows all of the frame, but for what does not fill a pixel of a coarse one at its edge. */
function isWhole({ part, widthPx, heightPx }: PictureFacts): boolean {
  return part !== null && widthPx - part.width_px < 4 && heightPx - part.height_px < 4;
}

/** Whether a picture has every pixel of what it shows. */
function hasEvery(part: Part): boolean {
  return part.picture_width_px === part.width_px && part.picture_height_px === part.height_px;
}

/** A canvas with nothing on it, of the size given or else its own. */
function begin(
  canvas: Surface | null,
  view: Size | undefined,
  settings?: CanvasRenderingContext2DSettings,
): Context | null {
  const context = (canvas?.getContext("2d", settings) ?? null) as Context | null;
  if (!canvas || !context) return null;
  if (view && (canvas.width !== view.width || canvas.height !== view.height)) {
    canvas.width = view.width;
    canvas.height = view.height;
  } else {
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
  }
  return context;
}

/** A small canvas, to be read. */
function surface(side: number): Context | null {
  const settings = { willReadFrequently: true };
  const canvas: Surface =
    typeof OffscreenCanvas === "undefined" ? document.createElement("canvas") : new OffscreenCanvas(1, 1);
  canvas.width = canvas.height = side;
  return canvas.getContext("2d", settings) as Context | null;
}

/** In the picture itself, which goes where no page says it. */
function drawStamp(context: Context, words: string, ratio: number): void {
  if (words === "") return;
  context.font = `700 ${13 * ratio}px system-ui`;
  const width = context.measureText(words).width;
  context.fillStyle = "#ffd21f";
  context.fillRect(0, 0, width + 16 * ratio, 22 * ratio);
  context.fillStyle = "#000";
  context.fillText(words, 8 * ratio, 16 * ratio);
}

/** Writes what a depth map's colours mean below it, smaller where there is no room. */
function drawLegend(context: Context, words: Stamps["depth"], below: Size, ratio: number): void {
  const height = LEGEND_PX * ratio;
  const [gap, square] = [8 * ratio, 12 * ratio];
  context.fillStyle = "#fff";
  context.fillRect(0, below.height, below.width, height);
  context.font = `${13 * ratio}px system-ui`;
  const parts = [
    { colour: FAR, text: words.far },
    { colour: NEAR, text: words.near },
    { colour: null, text: words.unknown },
  ];
  const widthOf = ({ colour, text }: (typeof parts)[number]) =>
    (colour ? square + gap : 0) + context.measureText(text).width + 2 * gap;
  const width = parts.reduce((sum, part) => sum + widthOf(part), gap);
  const scale = Math.min(1, below.width / width);
  context.setTransform(scale, 0, 0, scale, 0, below.height);
  let at = gap;
  for (const part of parts) {
    if (part.colour) {
      context.fillStyle = part.colour;
      context.fillRect(at, (height - square) / 2, square, square);
    }
    context.fillStyle = "#000";
    context.fillText(part.text, at + (part.colour ? square + gap : 0), height / 2 + 4.5 * ratio);
    at += widthOf(part);
  }
  context.setTransform(1, 0, 0, 1, 0, 0);
}

/** What is drawn, as a PNG. */
async function fileOf(width: number, height: number, draw: (context: Context) => void): Promise<Blob | null> {
  const canvas: Surface =
    typeof OffscreenCanvas === "undefined" ? document.createElement("canvas") : new OffscreenCanvas(1, 1);
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d") as Context | null;
  if (!context) return null;
  draw(context);
  if ("convertToBlob" in canvas) return canvas.convertToBlob({ type: "image/png" });
  return new Promise((resolve) => canvas.toBlob(resolve, "image/png"));
}
