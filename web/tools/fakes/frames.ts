/** Frames in the server's format, for tests: whole, in datagrams, and with a depth. */

export function frameBytes(header: object, body: Uint8Array<ArrayBuffer>): Uint8Array<ArrayBuffer> {
  const json = new TextEncoder().encode(JSON.stringify(header));
  const bytes = new Uint8Array(4 + json.length + body.length);
  new DataView(bytes.buffer).setUint32(0, json.length);
  bytes.set(json, 4);
  bytes.set(body, 4 + json.length);
  return bytes;
}

/** One datagram of a frame. */
export function fragment(seq: number, index: number, count: number, part: Uint8Array): Uint8Array<ArrayBuffer> {
  const datagram = new Uint8Array(8 + part.length);
  const view = new DataView(datagram.buffer);
  view.setUint32(0, seq);
  view.setUint16(4, index);
  view.setUint16(6, count);
  datagram.set(part, 8);
  return datagram;
}

/** A frame's datagrams with parts of this size, split like the server's. */
export function fragments(seq: number, whole: Uint8Array, size: number): Uint8Array<ArrayBuffer>[] {
  const count = Math.max(1, Math.ceil(whole.length / size));
  return Array.from({ length: count }, (_, i) => fragment(seq, i, count, whole.subarray(i * size, (i + 1) * size)));
}

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
  const picture = 11; // bytes, padded to an even number
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
