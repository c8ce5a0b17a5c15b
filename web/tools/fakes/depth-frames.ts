/** The beginning of a JPEG with a depth, and a WebP with one, for tests. */

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

export function webpWithDepth(nearest: number, image: Uint8Array): Uint8Array<ArrayBuffer> {
  const picture = 11; // bytes, and one more that makes them even
  const length = 4 + image.length;
  const webp = new Uint8Array(12 + 8 + picture + 1 + 8 + length + (length % 2));
  const view = new DataView(webp.buffer);
  const named = (at: number, name: string, size: number) => {
    webp.set(new TextEncoder().encode(name), at);
    view.setUint32(at + 4, size, true);
  };
  named(0, "RIFF", webp.length - 8);
  webp.set(new TextEncoder().encode("WEBP"), 8);
  named(12, "VP8 ", picture);
  named(32, "TDEP", length);
  view.setFloat32(40, nearest);
  webp.set(image, 44);
  return webp;
}
