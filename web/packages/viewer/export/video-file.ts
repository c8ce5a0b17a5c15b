/** A video file of single pictures, encoded by this browser. Loaded on demand. */
import {
  BufferTarget,
  CanvasSource,
  getFirstEncodableVideoCodec,
  Mp4OutputFormat,
  Output,
  Quality,
  WebMOutputFormat,
} from "mediabunny";

/** The first one that the browser encodes is used: most players know H.264. */
const CODECS = ["avc", "vp9", "vp8", "av1"] as const;

interface Shape {
  /** In pixels; even numbers, as encoders want them. */
  readonly width: number;
  readonly height: number;
  readonly framesPerSecond: number;
}

export class VideoFile {
  readonly #canvas: OffscreenCanvas;
  readonly #context: OffscreenCanvasRenderingContext2D;
  readonly #source: CanvasSource;
  readonly #output: Output<Mp4OutputFormat | WebMOutputFormat, BufferTarget>;
  readonly #duration: number;
  #frames = 0;

  private constructor(codec: (typeof CODECS)[number], quality: Quality, { width, height, framesPerSecond }: Shape) {
    this.#canvas = new OffscreenCanvas(width, height);
    const context = this.#canvas.getContext("2d");
    if (context === null) throw new Error("There is not enough memory for the video.");
    this.#context = context;
    this.#duration = 1 / framesPerSecond;
    this.#source = new CanvasSource(this.#canvas, { codec, quality });
    const format = codec === "avc" ? new Mp4OutputFormat() : new WebMOutputFormat();
    this.#output = new Output({ format, target: new BufferTarget() });
    this.#output.addVideoTrack(this.#source, { frameRate: framesPerSecond });
  }

  /** Rejects if this browser cannot encode such a video. */
  static async open(shape: Shape): Promise<VideoFile> {
    const quality = new Quality("very-high");
    const { width, height } = shape;
    const codec = await getFirstEncodableVideoCodec([...CODECS], { width, height, quality });
    if (codec === null) throw new Error("This browser cannot encode a video of this size.");
    const file = new VideoFile(codec as (typeof CODECS)[number], quality, shape);
    await file.#output.start();
    return file;
  }

  /** Appends a picture, and closes it. */
  async add(picture: ImageBitmap): Promise<void> {
    this.#context.drawImage(picture, 0, 0, this.#canvas.width, this.#canvas.height);
    picture.close();
    await this.#source.add(this.#frames++ * this.#duration, this.#duration);
  }

  async finish(): Promise<Blob> {
    await this.#output.finalize();
    return new Blob([this.#output.target.buffer ?? new ArrayBuffer(0)], { type: this.#output.format.mimeType });
  }

  async cancel(): Promise<void> {
    await this.#output.cancel();
  }
}
