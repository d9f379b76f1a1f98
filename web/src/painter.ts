// Draws the newest picture and what is laid over it, on canvases of a window or of a worker alike. What is seen of it is
// decided elsewhere.

import { pairs } from "./field-map";
import { linesOf, surfaceOf, type Line } from "./field-surface";
import { drawError, drawGrid, drawLines, drawPairs, type Context } from "./overlay";
import type { Overlay } from "./preferences";
import { SaturationWatch } from "./saturation-watch";
import { onFrame } from "./screen-frame";
import { extent } from "./show";
import { fit, pan, type Size, type Viewport } from "./viewport";
import type { FieldMap, Lens, Picture, PictureFacts, Show } from "./wire";

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

export class Painter {
  private canvas: Surface | null = null;
  private over: Surface | null = null;
  private bitmap: ImageBitmap | null = null;
  private facts: PictureFacts | null = null;
  private map: FieldMap | null = null;
  private links: [Lens, Lens][] = [];
  private lines: Line[] = [];
  private overlays: Overlay[] = [];
  private look: Look | null = null;
  private readonly saturated: SaturationWatch;
  private due = false;
  private dueOver = false;
  private probing: Context | null = null;
  /** How many times everything was forgotten: what was being decoded then is for nobody. */
  private forgotten = 0;

  /** `saturation` is told the share of the pixels that are saturated; null while nobody asks. */
  constructor(saturation: (share: number | null) => void) {
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
      bitmap = await createImageBitmap(new Blob([picture.jpeg], { type: "image/jpeg" }));
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
    this.bitmap?.close();
    this.bitmap = bitmap;
    this.facts = picture.facts;
    if (other) this.saturated.forget();
    // What is laid over is drawn anew when it is known anew, not with each picture.
    if (this.overlays.includes("saturation") && picture.facts.show === "raw") {
      this.saturated.look(picture.jpeg, performance.now());
    }
    this.drawPicture();
    if (other) this.soon(true);
    return { width: bitmap.width, height: bitmap.height };
  }

  /** Nothing of it is left for the next one who looks. */
  forget(): void {
    this.forgotten += 1;
    this.bitmap?.close();
    this.bitmap = this.facts = this.map = null;
    this.saturated.forget();
    this.links = [];
    this.lines = [];
    this.soon(true);
  }

  /** Shows it; how far its lines of equal spacing are apart, px, or null where it has none. */
  showMap(map: FieldMap): number | null {
    this.map = map;
    this.links = pairs(map);
    const surface = surfaceOf(map);
    this.lines = surface ? linesOf(surface) : [];
    this.soon(true);
    return surface?.stepPx ?? null;
  }

  showOverlays(overlays: Overlay[]): void {
    this.overlays = overlays;
    if (!overlays.includes("saturation")) this.saturated.forget();
    this.soon(true);
  }

  lookAt(look: Look): void {
    this.look = look;
    this.soon(true);
  }

  /** The grey level of a raw pixel; null where the picture shown does not have every one. */
  grey(x: number, y: number): number | null {
    if (!this.bitmap || this.facts?.show !== "raw" || this.facts.reduce !== 1) return null;
    const one = (this.probing ??= probe());
    one?.drawImage(this.bitmap, x, y, 1, 1, 0, 0, 1, 1);
    return one?.getImageData(0, 0, 1, 1).data[0] ?? null;
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
    // Single pixels are to be seen as such.
    context.imageSmoothingEnabled = scale < 2;
    context.drawImage(this.bitmap, left, top, seen.frame.width * scale, seen.frame.height * scale);
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

/** A canvas of a pixel, to be read. */
function probe(): Context | null {
  const settings = { willReadFrequently: true };
  const canvas: Surface =
    typeof OffscreenCanvas === "undefined" ? document.createElement("canvas") : new OffscreenCanvas(1, 1);
  canvas.width = canvas.height = 1;
  return canvas.getContext("2d", settings) as Context | null;
}
