// Has saturated pixels looked for now and then, one picture at a time.

/** Pixels that are saturated, as a picture of the frame's size, and their share of all. */
export interface Saturation {
  mask: ImageBitmap;
  share: number;
}

/** From one look to the next at least, ms; and how many times what one took, so that pictures keep most of a slow
 *  computer. */
const REST_MS = 300;
const REST = 5;

export class SaturationWatch {
  private worker: Worker | null = null;
  private askedAt = -Infinity;
  private tookMs = 0;
  private busy = false;
  private found: Saturation | null = null;

  /** `ready` is called when a look has come to something new. */
  constructor(private readonly ready: () => void) {}

  get newest(): Saturation | null {
    return this.found;
  }

  /** Looks at a picture, unless the last look is too recent or still under way. */
  look(picture: Blob, now: number): void {
    if (this.busy || now - this.askedAt < Math.max(REST_MS, REST * this.tookMs)) return;
    this.askedAt = now;
    this.busy = true;
    this.worker ??= this.start();
    this.worker.postMessage(picture);
  }

  /** Nothing of it is left. */
  forget(): void {
    this.worker?.terminate();
    this.worker = null;
    this.busy = false;
    this.askedAt = -Infinity;
    this.tookMs = 0;
    this.found?.mask.close();
    this.found = null;
  }

  private start(): Worker {
    const worker = new Worker(new URL("./saturation-worker.ts", import.meta.url), { type: "module" });
    worker.onmessage = (event: MessageEvent<Saturation | null>) => {
      this.busy = false;
      this.tookMs = performance.now() - this.askedAt;
      if (!event.data) return;
      this.found?.mask.close();
      this.found = event.data;
      this.ready();
    };
    return worker;
  }
}
