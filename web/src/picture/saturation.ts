// Pixels that got more light than they can tell.

/** A JPEG blurs what is saturated a little: from this grey level on a pixel counts. */
const FROM = 250;

/** Pixels (RGBA) saturated. With a `mask` of the same size they are marked in it, and all others made transparent. */
export function saturated(pixels: Uint8ClampedArray, mask?: Uint8ClampedArray): number {
  let count = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    const over = (pixels[i] ?? 0) >= FROM;
    if (over) count += 1;
    if (!mask) continue;
    mask[i] = 255;
    mask[i + 1] = 0;
    mask[i + 2] = 200;
    mask[i + 3] = over ? 255 : 0;
  }
  return count;
}
