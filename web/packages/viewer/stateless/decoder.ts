/** Decodes images in a worker. The caller closes the bitmaps. */
import { type CalledWorker, WorkerCalls } from "#client/async/worker-calls";
import type { DepthMap } from "../reproject/depth";

export interface DecodedImage {
  readonly bitmap: ImageBitmap;
  /** Depth of the whole frame; null if it has none. */
  readonly depth: DepthMap | null;
}

export class Decoder {
  readonly #calls: WorkerCalls<Blob, DecodedImage>;

  constructor(worker: CalledWorker) {
    this.#calls = new WorkerCalls(worker, ({ bitmap }) => bitmap.close());
  }

  /** Decodes one image. If the signal has aborted meanwhile, the bitmap is closed and the signal's reason thrown. */
  async decode(image: Blob, signal: AbortSignal): Promise<DecodedImage> {
    signal.throwIfAborted();
    const decoded = await this.#calls.call(image);
    if (signal.aborted) decoded.bitmap.close();
    signal.throwIfAborted();
    return decoded;
  }

  dispose(): void {
    this.#calls.dispose();
  }
}
