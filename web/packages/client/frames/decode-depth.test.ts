import { expect, test } from "vitest";
import { jpegWithDepth, webpWithDepth } from "#fakes/frames";
import { readDepthSegment } from "./decode-depth";

const CODES = Uint8Array.of(7, 8, 9);

test.each<[string, Uint8Array<ArrayBuffer>]>([
  ["nothing", new Uint8Array()],
  ["a JPEG without", Uint8Array.from({ length: 40 }, (_, i) => [0xff, 0xd8, 0xff, 0xe0, 0, 16][i] ?? 0)],
  ["a depth without an image", jpegWithDepth(1, new Uint8Array())],
  ["a depth that is cut off", jpegWithDepth(1, CODES).subarray(0, 24)],
  ["a WebP without", webpWithDepth(1, CODES).subarray(0, 35)],
  ["a WebP whose depth is cut off", webpWithDepth(1, CODES).subarray(0, -2)],
  ["a WebP whose depth is behind the camera", webpWithDepth(-1, CODES)],
  ["another program's segment", jpegWithDepth(1, CODES).map((byte, i) => (i === 8 ? 0 : byte))],
  ["a depth behind the camera", jpegWithDepth(-1, CODES)],
  ["a depth that is no number", jpegWithDepth(Number.NaN, CODES)],
  ["an infinite inverse depth", jpegWithDepth(Number.POSITIVE_INFINITY, CODES)],
])("%s has none", (_, jpeg) => {
  expect(readDepthSegment(jpeg)).toBeNull();
});
