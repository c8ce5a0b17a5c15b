/** Any bytes at the start of a frame yield a usable depth or null. */

import fc from "fast-check";
import { expect, test } from "vitest";
import { EFFORT } from "#fakes/effort";
import { jpegWithDepth, webpWithDepth } from "#fakes/frames";
import { readDepthSegment } from "./decode-depth";

const image = fc.uint8Array({ minLength: 1, maxLength: 60 });
const sound = fc.tuple(fc.float({ min: 0, noNaN: true, noDefaultInfinity: true }), image);
const edited = fc
  .tuple(
    sound,
    fc.boolean(),
    fc.array(fc.tuple(fc.nat({ max: 80 }), fc.nat({ max: 255 })), { maxLength: 4 }),
    fc.nat({ max: 100 }),
  )
  .map(([[nearest, codes], webp, edits, length]) => {
    const jpeg = (webp ? webpWithDepth : jpegWithDepth)(nearest, codes);
    for (const [at, byte] of edits) jpeg[at % jpeg.length] = byte;
    return jpeg.subarray(0, length);
  });

test("any bytes have a usable depth or none", () => {
  fc.assert(
    fc.property(fc.oneof(edited, fc.uint8Array()), (bytes) => {
      const jpeg = Uint8Array.from(bytes);
      const segment = readDepthSegment(jpeg);
      if (segment === null) return;
      expect(segment.nearest).toBeGreaterThanOrEqual(0);
      expect(Number.isFinite(segment.nearest)).toBe(true);
      expect(segment.image.length).toBeGreaterThan(0);
      expect(segment.image.byteOffset + segment.image.length).toBeLessThanOrEqual(jpeg.length);
    }),
    EFFORT,
  );
});

test("what was put in comes out, wherever the frame's bytes lie", () => {
  fc.assert(
    fc.property(sound, fc.boolean(), fc.nat({ max: 9 }), ([nearest, codes], webp, offset) => {
      const frame = (webp ? webpWithDepth : jpegWithDepth)(nearest, codes);
      const whole = new Uint8Array(offset + frame.length);
      whole.set(frame, offset);
      const segment = readDepthSegment(whole.subarray(offset));
      expect(segment?.nearest).toBe(nearest);
      expect(Uint8Array.from(segment?.image ?? [])).toEqual(codes);
    }),
    EFFORT,
  );
});
