/** The beginning of a JPEG with a depth, for tests. */

export function jpegWithDepth(nearest: number, image: Uint8Array): Uint8Array<ArrayBuffer> {
  const identifier = new TextEncoder().encode("tigas:depth\0");
  const jpeg = new Uint8Array(22 + image.length + 4);
  const view = new DataView(jpeg.buffer);
  view.setUint16(0, 0xffd8);
  view.setUint16(2, 0xffe9);
  view.setUint16(4, 18 + image.length);
  jpeg.set(identifier, 6);
  view.setFloat32(18, nearest);
  jpeg.set(image, 22);
  view.setUint32(22 + image.length, 0xffdb0043);
  return jpeg;
}
