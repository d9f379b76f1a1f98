// Draws the newest picture and what is laid over it. It is outside the page's state: pictures come thirty times a second,
// and only they are drawn then.

import { pairs, range, tint } from "./field-map";
import type { Overlay } from "./preferences";
import { SaturationWatch } from "./saturation-watch";
import { extent } from "./show";
import { fit, isWhole, pan, pixelAt, zoom, type Size, type Viewport } from "./viewport";
import type { FieldMap, Lens, Picture, PictureFacts } from "./wire";

const GRID = "#5ad2c0";
const CROSS = "#ff4fd0";
const PAIR = "#ffffff";

export class Painter {
  private canvas: HTMLCanvasElement | null = null;
  private over: HTMLCanvasElement | null = null;
  private bitmap: ImageBitmap | null = null;
  private facts: PictureFacts | null = null;
  private map: FieldMap | null = null;
  private links: [Lens, Lens][] = [];
  private overlays: Overlay[] = [];
  /** Null while the whole frame is shown. */
  private viewport: Viewport | null = null;
  private readonly saturated = new SaturationWatch(() => this.soon(true));
  private due = false;
  private dueOver = false;
  private times: number[] = [];

  /** Draws on these from now on; returns what lets go of them. */
  attach(canvas: HTMLCanvasElement, over: HTMLCanvasElement): () => void {
    this.canvas = canvas;
    this.over = over;
    const resized = new ResizeObserver(() => this.soon(true));
    resized.observe(canvas);
    this.soon(true);
    return () => {
      resized.disconnect();
      this.canvas = this.over = null;
    };
  }

  /** Shows a picture unless a newer one is shown already; false where it cannot be read. */
  async show(picture: Picture): Promise<boolean> {
    let bitmap: ImageBitmap;
    try {
      bitmap = await createImageBitmap(new Blob([picture.jpeg], { type: "image/jpeg" }));
    } catch {
      return false;
    }
    const other = this.facts !== null && picture.facts.show !== this.facts.show;
    // A view is ready later than the raw frame that it is made of: when they change it is older, and shown all the same.
    if (this.facts && this.bitmap && !other && picture.facts.capturedAt < this.facts.capturedAt) {
      bitmap.close();
      return false;
    }
    // Places count otherwise in it.
    if (other) this.viewport = null;
    this.bitmap?.close();
    this.bitmap = bitmap;
    this.facts = picture.facts;
    const now = performance.now();
    this.times = [...this.times.filter((time) => now - time < 2000), now];
    if (other) this.saturated.forget();
    // What is laid over is drawn anew when it is known anew, not with each picture.
    if (this.overlays.includes("saturation") && picture.facts.show === "raw") {
      this.saturated.look(picture.jpeg, now);
    }
    this.soon(other);
    return true;
  }

  /** Nothing of it is left for the next one who looks. */
  forget(): void {
    this.bitmap?.close();
    this.bitmap = this.facts = this.map = this.viewport = null;
    this.saturated.forget();
    this.links = [];
    this.soon(true);
  }

  showMap(map: FieldMap): void {
    this.map = map;
    this.links = pairs(map);
    this.soon(true);
  }

  showOverlays(overlays: Overlay[]): void {
    if (overlays === this.overlays) return;
    this.overlays = overlays;
    if (!overlays.includes("saturation")) this.saturated.forget();
    this.soon(true);
  }

  /** Pictures shown a second, of late. */
  get rate(): number {
    const now = performance.now();
    return this.times.filter((time) => now - time < 2000).length / 2;
  }

  get newestMap(): FieldMap | null {
    return this.map;
  }

  /** Share of the pixels that are saturated; null while nobody asks. */
  get saturation(): number | null {
    return this.saturated.newest?.share ?? null;
  }

  /** Pixels of the screen to a raw one. */
  get scale(): number | null {
    return this.seen()?.viewport.scale ?? null;
  }

  get whole(): boolean {
    return this.viewport === null;
  }

  /** `about` is in CSS pixels from the canvas's corner; the middle where it is not given. */
  zoom(factor: number, about?: { x: number; y: number }): void {
    const seen = this.seen();
    if (!seen) return;
    const ratio = this.ratio();
    const at = about
      ? { x: about.x * ratio, y: about.y * ratio }
      : { x: seen.view.width / 2, y: seen.view.height / 2 };
    const next = zoom(seen.viewport, factor, at, seen.view, seen.frame);
    this.viewport = isWhole(next, seen.view, seen.frame) ? null : next;
    this.soon(true);
  }

  /** One raw pixel to one pixel of the screen. */
  pixelForPixel(): void {
    const scale = this.scale;
    if (scale !== null) this.zoom(1 / scale);
  }

  all(): void {
    this.viewport = null;
    this.soon(true);
  }

  /** In CSS pixels. */
  pan(dx: number, dy: number): void {
    const seen = this.seen();
    if (!seen || this.viewport === null) return;
    this.viewport = pan(seen.viewport, dx * this.ratio(), dy * this.ratio(), seen.view, seen.frame);
    this.soon(true);
  }

  /** The raw pixel at a place of the canvas, CSS pixels, and its grey level where the picture has every pixel; null where
   *  no raw frame is shown. */
  probe(at: { x: number; y: number }): { x: number; y: number; grey: number | null } | null {
    const seen = this.seen();
    const pixel =
      seen && pixelAt(seen.viewport, { x: at.x * this.ratio(), y: at.y * this.ratio() }, seen.frame);
    if (!pixel || !this.bitmap || this.facts?.show !== "raw") return null;
    if (this.facts.reduce !== 1) return { ...pixel, grey: null };
    const one = new OffscreenCanvas(1, 1).getContext("2d");
    one?.drawImage(this.bitmap, pixel.x, pixel.y, 1, 1, 0, 0, 1, 1);
    return { ...pixel, grey: one?.getImageData(0, 0, 1, 1).data[0] ?? null };
  }

  private ratio(): number {
    return window.devicePixelRatio || 1;
  }

  private seen(): { viewport: Viewport; view: Size; frame: Size } | null {
    if (!this.canvas || !this.facts || !this.bitmap) return null;
    const view = {
      width: Math.round(this.canvas.clientWidth * this.ratio()),
      height: Math.round(this.canvas.clientHeight * this.ratio()),
    };
    const frame = extent(this.facts, this.bitmap);
    if (view.width === 0 || view.height === 0) return null;
    // Another size of the view or of the frame: kept in sight.
    const viewport = this.viewport ? pan(this.viewport, 0, 0, view, frame) : fit(view, frame);
    return { viewport, view, frame };
  }

  private soon(over: boolean): void {
    this.dueOver ||= over;
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => {
      this.due = false;
      this.drawPicture();
      if (this.dueOver) this.drawOver();
      this.dueOver = false;
    });
  }

  private begin(canvas: HTMLCanvasElement | null, view: Size): CanvasRenderingContext2D | null {
    const context = canvas?.getContext("2d") ?? null;
    if (!canvas || !context) return null;
    if (canvas.width !== view.width || canvas.height !== view.height) {
      canvas.width = view.width;
      canvas.height = view.height;
    } else {
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, view.width, view.height);
    }
    return context;
  }

  private drawPicture(): void {
    const seen = this.seen();
    const context = seen && this.begin(this.canvas, seen.view);
    if (!seen || !context || !this.bitmap) {
      this.canvas?.getContext("2d")?.clearRect(0, 0, this.canvas.width, this.canvas.height);
      return;
    }
    const { scale, left, top } = seen.viewport;
    // Single pixels are to be seen as such.
    context.imageSmoothingEnabled = scale < 2;
    context.drawImage(this.bitmap, left, top, seen.frame.width * scale, seen.frame.height * scale);
  }

  private drawOver(): void {
    const seen = this.seen();
    const context = this.over && this.begin(this.over, seen?.view ?? { width: 1, height: 1 });
    if (!seen || !context) return;
    const { scale, left, top } = seen.viewport;
    // Centres are at the middle of pixels.
    context.setTransform(scale, 0, 0, scale, left + scale / 2, top + scale / 2);
    context.lineWidth = (1.4 * this.ratio()) / scale;
    if (this.overlays.includes("saturation")) this.drawSaturation(context, seen.frame);
    const map = this.map;
    if (!map) return;
    if (this.overlays.includes("error")) drawError(context, map);
    if (this.overlays.includes("pairs")) drawPairs(context, this.links);
    if (this.overlays.includes("grid")) drawGrid(context, map);
  }

  private drawSaturation(context: CanvasRenderingContext2D, frame: Size): void {
    const found = this.saturated.newest;
    if (!found) return;
    context.imageSmoothingEnabled = false;
    context.drawImage(found.mask, -0.5, -0.5, frame.width, frame.height);
  }
}

function disc(context: CanvasRenderingContext2D, lens: Lens, radius: number): void {
  context.moveTo(lens.x + radius, lens.y);
  context.arc(lens.x, lens.y, radius, 0, 2 * Math.PI);
}

function drawError(context: CanvasRenderingContext2D, map: FieldMap): void {
  const rangePx = range(map);
  for (const lens of map.lenses) {
    const colour = tint(lens, map.targetPx, rangePx);
    if (colour === null) continue;
    context.fillStyle = colour;
    context.beginPath();
    disc(context, lens, 0.48 * map.pitchPx);
    context.fill();
  }
}

function drawPairs(context: CanvasRenderingContext2D, links: [Lens, Lens][]): void {
  context.strokeStyle = PAIR;
  context.beginPath();
  for (const [from, to] of links) {
    const at = (share: number): [number, number] => [
      from.x + share * (to.x - from.x),
      from.y + share * (to.y - from.y),
    ];
    context.moveTo(...at(0.38));
    context.lineTo(...at(0.62));
  }
  context.stroke();
}

function drawGrid(context: CanvasRenderingContext2D, map: FieldMap): void {
  const radius = 0.46 * map.pitchPx;
  const ring = (fate: Lens["fate"], colour: string, dash: number[]) => {
    context.setLineDash(dash);
    context.strokeStyle = colour;
    context.beginPath();
    for (const lens of map.lenses) if (lens.fate === fate) disc(context, lens, radius);
    context.stroke();
  };
  ring("matched", GRID, []);
  ring("blank", GRID, [radius / 4, radius / 4]);
  ring("mismatched", CROSS, []);
  context.beginPath();
  for (const lens of map.lenses) {
    if (lens.fate !== "mismatched") continue;
    const arm = 0.6 * radius;
    context.moveTo(lens.x - arm, lens.y - arm);
    context.lineTo(lens.x + arm, lens.y + arm);
    context.moveTo(lens.x - arm, lens.y + arm);
    context.lineTo(lens.x + arm, lens.y - arm);
  }
  context.stroke();
}

/** The page's one. */
export const painter = new Painter();
