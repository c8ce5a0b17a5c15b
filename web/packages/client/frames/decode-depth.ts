/** Decodes the depth that a frame carries, in a worker. */
import type { DepthMap } from "../transport/picture";
import { DEPTH_SEGMENT_BYTES, readDepthSegment } from "./depth-segment";

/** No side of a coarse depth is longer; every graphics processor takes such an image. */
const MOST_SIDE = 1024;

/** Null if the frame has none, or none that can be read: a frame without depth is still a frame. */
export async function decodeDepth(frame: Blob): Promise<DepthMap | null> {
  try {
    const part = frame.type === "image/webp" ? frame : frame.slice(0, DEPTH_SEGMENT_BYTES); // a JPEG's is at its start
    const segment = readDepthSegment(new Uint8Array(await part.arrayBuffer()));
    return segment && { nearest: segment.nearest, ...(await grayValues(segment.image)) };
  } catch {
    return null;
  }
}

/** Throws if it is no image, or too large a one. */
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
