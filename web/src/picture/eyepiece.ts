// What one looks at the picture through: which part of it is seen, how large, and what its pixels are. It is outside the
// page's state: one zooms and pans faster than the page's text is drawn.

import { Marking, type Seen } from "./marking";
import type { Place } from "./marks";
import { Newest } from "../daemon/newest";
import type { Stamps, Taken } from "./painter";
import type { Overlay } from "../preferences";
import { Rate } from "../browser/rate";
import { extent } from "./show";
import type { Command, MapFacts, Report } from "./viewer";
import { ViewerThread } from "./viewer-thread";
import { fit, isWhole, pan, pixelAt, zoom, type Size, type Viewport } from "./viewport";
import type { PictureFacts } from "../daemon/wire";
import { sameWish, type Wish } from "../daemon/wish";

/** A raw pixel, and its grey level where the picture has every one. */
export interface Probe {
  x: number;
  y: number;
  grey: number | null;
}

export class Eyepiece {
  private thread: ViewerThread | null = null;
  private canvas: HTMLCanvasElement | null = null;
  /** The picture drawn last. */
  private drawn: { facts: PictureFacts; size: Size } | null = null;
  /** Null while the whole of it is shown. */
  private viewport: Viewport | null = null;
  private wish: Wish | null = null;
  private overlays: Overlay[] | null = null;
  private map: MapFacts | null = null;
  private share: number | null = null;
  private snapshots = 0;
  private readonly taking = new Map<number, (taken: Taken | null) => void>();
  private changed = () => {};
  private readonly pictures = new Rate();
  private readonly probed = new Newest();
  private readonly asked = new Map<number, (grey: number | null) => void>();
  private probes = 0;
  /** What is measured in it. */
  readonly marking = new Marking(
    () => this.seenRaw(),
    (marks) => {
      this.post({ do: "mark", marks });
      this.changed();
    },
  );
  /** How many times what draws was replaced: a canvas serves one of them only. */
  replaced = 0;

  /** Opens it; `report` is told what came, `changed` that what is said here has changed. */
  start(report: (report: Report) => void, changed: () => void): void {
    const heed = (said: Report) => {
      this.heed(said);
      report(said);
    };
    this.changed = changed;
    this.thread = new ViewerThread(heed, () => {
      this.replaced += 1;
      this.drawn = this.map = this.share = null;
      for (const answer of this.asked.values()) answer(null);
      this.asked.clear();
      for (const answer of this.taking.values()) answer(null);
      this.taking.clear();
      changed();
    });
  }

  open(): void {
    this.post({ do: "open" });
  }

  close(): void {
    this.post({ do: "close" });
  }

  /** Has a lost connection tried again at once. */
  retry(): void {
    this.post({ do: "retry" });
  }

  want(wish: Wish): void {
    if (this.wish && sameWish(wish, this.wish)) return;
    this.wish = wish;
    this.post({ do: "want", wish });
  }

  showOverlays(overlays: Overlay[]): void {
    if (overlays.join() === this.overlays?.join()) return;
    this.overlays = overlays;
    if (!overlays.includes("saturation")) this.share = null;
    this.post({ do: "overlay", overlays });
  }

  /** Nothing of it is left for the next one who looks. */
  forget(): void {
    this.drawn = this.map = this.viewport = this.share = null;
    this.marking.forget();
    this.pictures.forget();
    this.post({ do: "forget" });
    this.look();
  }

  /** What was measured over the field is of what was before the lens then. */
  forgetMap(): void {
    this.map = null;
    this.post({ do: "forget-map" });
  }

  /** Has it drawn on these from now on; returns what lets go of them. */
  attach(canvas: HTMLCanvasElement, over: HTMLCanvasElement): () => void {
    this.canvas = canvas;
    this.thread?.attach(canvas, over);
    const resized = new ResizeObserver(() => this.look());
    resized.observe(canvas);
    this.look();
    return () => {
      resized.disconnect();
      this.canvas = null;
      this.post({ do: "detach" });
    };
  }

  /** Pictures drawn a second, of late. */
  get rate(): number {
    return this.pictures.at(performance.now());
  }

  get newestMap(): MapFacts | null {
    return this.map;
  }

  /** Share of the pixels that are saturated; null while nobody asks. */
  get saturation(): number | null {
    return this.share;
  }

  /** Pixels of the screen to a raw one. */
  get scale(): number | null {
    return this.seen()?.viewport.scale ?? null;
  }

  get whole(): boolean {
    return this.viewport === null;
  }

  /** `about` is in CSS pixels from the canvas's corner; the middle where it is not given. */
  zoom(factor: number, about?: Place): void {
    const seen = this.seen();
    if (!seen) return;
    const ratio = this.ratio();
    const at = about
      ? { x: about.x * ratio, y: about.y * ratio }
      : { x: seen.view.width / 2, y: seen.view.height / 2 };
    const next = zoom(seen.viewport, factor, at, seen.view, seen.frame);
    this.viewport = isWhole(next, seen.view, seen.frame) ? null : next;
    this.look();
  }

  /** One raw pixel to one pixel of the screen. */
  pixelForPixel(): void {
    const scale = this.scale;
    if (scale !== null) this.zoom(1 / scale);
  }

  all(): void {
    this.viewport = null;
    this.look();
  }

  /** In CSS pixels. */
  pan(dx: number, dy: number): void {
    const seen = this.seen();
    if (!seen || this.viewport === null) return;
    this.viewport = pan(seen.viewport, dx * this.ratio(), dy * this.ratio(), seen.view, seen.frame);
    this.look();
  }

  /** The raw pixel at a place of the canvas, CSS pixels; `say` is told null where no raw frame is shown, and nothing where
   *  it is asked for another meanwhile. */
  async probe(at: Place, say: (probe: Probe | null) => void): Promise<void> {
    const seen = this.seen();
    const pixel =
      seen && pixelAt(seen.viewport, { x: at.x * this.ratio(), y: at.y * this.ratio() }, seen.frame);
    const raw = pixel && this.drawn?.facts.show === "raw" ? pixel : null;
    const answer = raw ? this.grey(raw).then((grey) => ({ ...raw, grey })) : Promise.resolve(null);
    const found = await this.probed.of(answer.then((probe) => ({ probe })));
    if (found) say(found.probe);
  }

  /** What is seen, with what is laid over it, as a PNG; null where nothing is. */
  snapshot(stamps: Stamps): Promise<Taken | null> {
    const snapshot = ++this.snapshots;
    return new Promise((resolve) => {
      this.taking.set(snapshot, resolve);
      this.post({ do: "snapshot", snapshot, stamps });
    });
  }

  private grey(pixel: Place): Promise<number | null> {
    const probe = ++this.probes;
    return new Promise((resolve) => {
      this.asked.set(probe, resolve);
      this.post({ do: "probe", probe, ...pixel });
    });
  }

  private heed(report: Report): void {
    switch (report.is) {
      case "picture": {
        this.pictures.note(performance.now());
        const other = this.drawn !== null && this.drawn.facts.show !== report.facts.show;
        const first = this.drawn === null;
        this.drawn = report;
        if (report.facts.show === "raw") this.marking.keepWithin(extent(report.facts, report.size));
        // Places count otherwise in it.
        if (other) this.viewport = null;
        if (other || first) this.look();
        return;
      }
      case "map":
        this.map = report.map;
        return;
      case "saturation":
        this.share = this.overlays?.includes("saturation") ? report.share : null;
        return;
      case "region":
        this.marking.heed(report.facts);
        this.changed();
        return;
      case "snapshot":
        this.taking.get(report.snapshot)?.(report.taken);
        this.taking.delete(report.snapshot);
        return;
      case "grey":
        this.asked.get(report.probe)?.(report.grey);
        this.asked.delete(report.probe);
    }
  }

  private post(command: Command): void {
    this.thread?.post(command);
  }

  private look(): void {
    const view = this.view();
    if (!view) return;
    const show = this.drawn?.facts.show ?? "raw";
    this.post({ do: "look", look: { view, ratio: this.ratio(), viewport: this.viewport, show } });
  }

  private ratio(): number {
    return window.devicePixelRatio || 1;
  }

  private view(): Size | null {
    if (!this.canvas) return null;
    const { clientWidth, clientHeight } = this.canvas;
    return {
      width: Math.round(clientWidth * this.ratio()),
      height: Math.round(clientHeight * this.ratio()),
    };
  }

  /** In CSS pixels; null where no raw frame is shown. */
  private seenRaw(): Seen | null {
    const seen = this.drawn?.facts.show === "raw" ? this.seen() : null;
    if (!seen) return null;
    const ratio = this.ratio();
    const { scale, left, top } = seen.viewport;
    return {
      viewport: { scale: scale / ratio, left: left / ratio, top: top / ratio },
      view: { width: seen.view.width / ratio, height: seen.view.height / ratio },
      frame: seen.frame,
    };
  }

  private seen(): Seen | null {
    const view = this.view();
    if (!view || !this.drawn || view.width === 0 || view.height === 0) return null;
    const frame = extent(this.drawn.facts, this.drawn.size);
    // Another size of the view or of the frame: kept in sight.
    const viewport = this.viewport ? pan(this.viewport, 0, 0, view, frame) : fit(view, frame);
    return { viewport, view, frame };
  }
}

/** The page's one. */
export const eyepiece = new Eyepiece();
