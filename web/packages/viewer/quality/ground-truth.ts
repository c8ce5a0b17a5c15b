/** The view rendered losslessly by the server for the viewport, and the similarity of pictures to it. */
import { FetchTransport } from "#client/transport/fetch";
import { hostUrl } from "#client/transport/host-report";
import type { ServerConfig } from "#client/wire/render";
import type { ScenePose } from "../view/camera";
import type { Intrinsics, Viewport } from "../view/intrinsics";

/** Value for equal pictures. */
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

interface Place {
  /** Null while it is unknown. */
  readonly server: ServerConfig | null;
  readonly scene: string;
  readonly lens: Intrinsics & Viewport;
}

/** The view as PNG, requested by `POST /render`, independently of the viewer's connection. Rejects like a transport. */
export async function losslessView(
  { server, scene, lens }: Place,
  { position, quaternion }: ScenePose,
  signal: AbortSignal,
): Promise<Blob> {
  if (server === null) throw new Error("The server's address is not known yet.");
  const transport = new FetchTransport(() => performance.now(), hostUrl("render", server));
  try {
    const { image } = await transport.request({ scene, seq: 0, position, quaternion, ...lens, format: "png" }, signal);
    return image;
  } finally {
    transport.close();
  }
}

/** The same view, decoded. */
export async function groundTruth(place: Place, pose: ScenePose, signal: AbortSignal): Promise<ImageBitmap> {
  return createImageBitmap(await losslessView(place, pose, signal));
}

/** PSNR of each picture in dB, at the truth's size; null counts as black. */
export function psnrOf(pictures: readonly (ImageBitmap | null)[], truth: ImageBitmap): readonly number[] {
  const { width, height } = truth;
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  if (context === null) throw new Error("There is not enough memory to compare pictures.");
  const pixels = (picture: ImageBitmap | null) => {
    context.fillStyle = "black";
    context.fillRect(0, 0, width, height);
    if (picture) context.drawImage(picture, 0, 0, width, height);
    return context.getImageData(0, 0, width, height).data;
  };
  const wanted = pixels(truth);
  return pictures.map((picture) => psnr(pixels(picture), wanted));
}
