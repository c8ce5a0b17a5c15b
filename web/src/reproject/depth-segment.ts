/**
 * The depth that a frame carries: a JPEG's first segment after its start, APP9, which every other reader skips. It has an identifier,
 * the inverse depth of code 255 as a big-endian float32, and an image of codes.
 */

const IDENTIFIER = new TextEncoder().encode("tigas:depth\0");
const START_OF_IMAGE = 0xffd8;
const APP9 = 0xffe9;
/** Of the start of the image, the marker and the segment's length, which counts itself. */
const MARKER_BYTES = 4;
const LENGTH_BYTES = 2;
const IMAGE_AT = MARKER_BYTES + LENGTH_BYTES + IDENTIFIER.length + 4;

/** So many bytes of a JPEG are enough to read any segment. */
export const DEPTH_SEGMENT_BYTES = MARKER_BYTES + 0xffff;

export interface DepthSegment {
  /** The inverse depth of code 255, in 1/scene units. */
  readonly nearest: number;
  /** An encoded image of one gray channel. */
  readonly image: Uint8Array<ArrayBuffer>;
}

/** Reads a JPEG's first bytes; null if there is no depth in them, or none that makes sense. */
export function readDepthSegment(jpeg: Uint8Array<ArrayBuffer>): DepthSegment | null {
  if (jpeg.length <= IMAGE_AT) return null;
  const view = new DataView(jpeg.buffer, jpeg.byteOffset, jpeg.length);
  if (view.getUint16(0) !== START_OF_IMAGE || view.getUint16(2) !== APP9) return null;
  if (IDENTIFIER.some((byte, i) => jpeg[MARKER_BYTES + LENGTH_BYTES + i] !== byte)) return null;
  const end = MARKER_BYTES + view.getUint16(MARKER_BYTES);
  const nearest = view.getFloat32(IMAGE_AT - 4);
  if (end <= IMAGE_AT || end > jpeg.length || !Number.isFinite(nearest) || nearest < 0) return null;
  return { nearest, image: jpeg.subarray(IMAGE_AT, end) };
}
