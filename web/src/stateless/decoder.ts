/** Decodes images in a worker. Whoever gets a bitmap closes it. */
import { type CalledWorker, WorkerCalls } from "../async/worker-calls";
import type { DepthMap } from "../reproject/depth";

export interface DecodedImage {
  readonly bitmap: ImageBitmap;
  /** Of the whole frame; null if it came without. */
  readonly depth: DepthMap | null;
}

export class Decoder {
  readonly #calls: WorkerCalls<Blob, DecodedImage>;

  constructor(worker: CalledWorker) {
    this.#calls = new WorkerCalls(worker, ({ bitmap }) => bitmap.close());
  }

  /** Decodes one image. If nobody wants it any more when it is done, its bitmap is closed and the signal's reason thrown. */
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
