// Looks for saturated pixels off the main thread: every pixel of a picture is read.

import { saturated } from "./saturation";
import type { Saturation } from "./saturation-watch";

/** The worker's own scope, as far as it is used here. */
interface Scope {
  onmessage: ((event: MessageEvent<Blob>) => void) | null;
  postMessage(message: Saturation | null, transfer: Transferable[]): void;
}

const scope = globalThis as unknown as Scope;

scope.onmessage = (event) => {
  // What cannot be read has no saturated pixels to be shown; the next picture can be.
  look(event.data).catch(() => scope.postMessage(null, []));
};

async function look(picture: Blob): Promise<void> {
  const bitmap = await createImageBitmap(picture);
  const { width, height } = bitmap;
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new Error("no canvas");
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const pixels = context.getImageData(0, 0, width, height);
  const count = saturated(pixels.data, pixels.data);
  context.putImageData(pixels, 0, 0);
  const mask = canvas.transferToImageBitmap();
  scope.postMessage({ mask, share: count / (width * height) }, [mask]);
}
