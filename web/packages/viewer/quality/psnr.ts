/** How near a picture is to another, as reports measure it (docs/experiments.md). */

/** Of pictures that are equal. */
export const BEST_PSNR = 100;

/** Peak signal-to-noise ratio over red, green and blue of 8 bits, in dB: both are RGBA of as many pixels. */
export function psnr(a: Uint8ClampedArray, b: Uint8ClampedArray): number {
  let squares = 0;
  for (let at = 0; at < a.length; at += 4) {
    for (let channel = at; channel < at + 3; channel++) {
      const difference = (a[channel] ?? 0) - (b[channel] ?? 0);
      squares += difference * difference;
    }
  }
  const error = squares / ((a.length / 4) * 3);
  return Math.min(BEST_PSNR, 10 * Math.log10(255 ** 2 / error));
}
