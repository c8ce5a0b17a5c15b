/** A video file made of single pictures, encoded by this browser. Loaded on demand. */
import {
  BufferTarget,
  CanvasSource,
  getFirstEncodableVideoCodec,
  Mp4OutputFormat,
  Output,
  Quality,
  WebMOutputFormat,
} from "mediabunny";

interface Shape {
  /** In pixels; even numbers, as encoders require. */
  readonly width: number;
  readonly height: number;
  readonly framesPerSecond: number;
}

/** Encodes these pictures into a file, and closes them. Rejects if this browser cannot encode such a video. */
export async function videoFile(
  { width, height, framesPerSecond }: Shape,
  pictures: AsyncIterable<ImageBitmap>,
): Promise<Blob> {
  const quality = new Quality("very-high");
  // The first codec that the browser can encode is used; most players support H.264.
  const codec = await getFirstEncodableVideoCodec(["avc", "vp9", "vp8", "av1"], { width, height, quality });
  if (codec === null) throw new Error("This browser cannot encode a video of this size.");
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d");
  if (context === null) throw new Error("There is not enough memory for the video.");
  const source = new CanvasSource(canvas, { codec, quality });
  const target = new BufferTarget();
  const format = codec === "avc" ? new Mp4OutputFormat() : new WebMOutputFormat();
  const output = new Output({ format, target });
  output.addVideoTrack(source, { frameRate: framesPerSecond });
  await output.start();
  try {
    let frames = 0;
    for await (const picture of pictures) {
      context.drawImage(picture, 0, 0, width, height);
      picture.close();
      await source.add(frames++ / framesPerSecond, 1 / framesPerSecond);
    }
    await output.finalize();
  } catch (error) {
    await output.cancel();
    throw error;
  }
  return new Blob([target.buffer ?? new ArrayBuffer(0)], { type: format.mimeType });
}
