/** Decodes the depth that a frame carries, in a worker. */
import type { DepthMap } from "../transport/transport";

/**
 * The depth that a frame carries, in a place that other readers skip: a JPEG's first segment after its start, APP9, with an identifier,
 * or a WebP's last chunk, TDEP. It has the inverse depth of code 255 as a big-endian float32, and an image of codes.
 */
const IDENTIFIER = new TextEncoder().encode("tigas:depth\0");
const START_OF_IMAGE = 0xffd8;
const APP9 = 0xffe9;
/** Bytes of the image's start, the marker, and the segment's length, which counts itself. */
const MARKER_BYTES = 4;
const LENGTH_BYTES = 2;
const IMAGE_AT = MARKER_BYTES + LENGTH_BYTES + IDENTIFIER.length + 4;

/** Bytes of a JPEG that suffice to read any segment. */
export const DEPTH_SEGMENT_BYTES = MARKER_BYTES + 0xffff;

export interface DepthSegment {
  /** The inverse depth of code 255, in 1/scene units. */
  readonly nearest: number;
  /** An encoded image of one gray channel. */
  readonly image: Uint8Array<ArrayBuffer>;
}

const RIFF = 0x52494646;
const TDEP = 0x54444550;
/** Bytes of a chunk's name and length, and of the name of the first one's content. */
const CHUNK_BYTES = 8;
const FORM_BYTES = 4;

/** Reads a JPEG's first bytes, or a whole WebP; null if they contain no valid depth. */
export function readDepthSegment(frame: Uint8Array<ArrayBuffer>): DepthSegment | null {
  if (frame.length <= IMAGE_AT) return null;
  const view = new DataView(frame.buffer, frame.byteOffset, frame.length);
  return view.getUint32(0) === RIFF ? inWebp(frame, view) : inJpeg(frame, view);
}

function inJpeg(jpeg: Uint8Array<ArrayBuffer>, view: DataView): DepthSegment | null {
  if (view.getUint16(0) !== START_OF_IMAGE || view.getUint16(2) !== APP9) return null;
  if (IDENTIFIER.some((byte, i) => jpeg[MARKER_BYTES + LENGTH_BYTES + i] !== byte)) return null;
  return depthAt(IMAGE_AT, MARKER_BYTES + view.getUint16(MARKER_BYTES), jpeg, view);
}

function inWebp(webp: Uint8Array<ArrayBuffer>, view: DataView): DepthSegment | null {
  for (let at = CHUNK_BYTES + FORM_BYTES; at + CHUNK_BYTES + 4 < webp.length; ) {
    const content = at + CHUNK_BYTES;
    const length = view.getUint32(at + 4, true);
    if (view.getUint32(at) === TDEP) return depthAt(content + 4, content + length, webp, view);
    at = content + length + (length % 2);
  }
  return null;
}

/** The depth with an image from `begin` to `end`, preceded by the inverse depth. */
function depthAt(begin: number, end: number, frame: Uint8Array<ArrayBuffer>, view: DataView): DepthSegment | null {
  const nearest = view.getFloat32(begin - 4);
  if (end <= begin || end > frame.length || !Number.isFinite(nearest) || nearest < 0) return null;
  return { nearest, image: frame.subarray(begin, end) };
}

/** No side of a coarse depth is longer; every graphics processor takes such an image. */
const MOST_SIDE = 1024;

/** Null if the frame has no readable depth: a frame without depth is still a frame. */
export async function decodeDepth(frame: Blob): Promise<DepthMap | null> {
  try {
    const part = frame.type === "image/webp" ? frame : frame.slice(0, DEPTH_SEGMENT_BYTES); // a JPEG's is at its start
    const segment = readDepthSegment(new Uint8Array(await part.arrayBuffer()));
    return segment && { nearest: segment.nearest, ...(await grayValues(segment.image)) };
  } catch {
    return null;
  }
}

/** Throws if it is not an image, or too large. */
async function grayValues(encoded: Uint8Array<ArrayBuffer>): Promise<Omit<DepthMap, "nearest">> {
  // The values are codes, not colours, and must not be colour-managed.
  const image = await createImageBitmap(new Blob([encoded]), {
    colorSpaceConversion: "none",
    premultiplyAlpha: "none",
  });
  const { width, height } = image;
  try {
    if (Math.max(width, height) > MOST_SIDE) throw new RangeError(`a depth of ${width}×${height} pixels is not coarse`);
    const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    if (context === null) throw new Error("this worker cannot read images");
    context.drawImage(image, 0, 0);
    const { data } = context.getImageData(0, 0, width, height);
    const codes = new Uint8Array(width * height);
    for (let i = 0; i < codes.length; i++) codes[i] = data[4 * i] as number; // red, green and blue are the same
    return { width, height, codes };
  } finally {
    image.close();
  }
}
