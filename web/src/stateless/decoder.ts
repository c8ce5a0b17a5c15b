/** Decodes images in a worker. Whoever gets a bitmap closes it. */
import { type CalledWorker, WorkerCalls } from "../async/worker-calls";

export class Decoder {
  readonly #calls: WorkerCalls<Blob, ImageBitmap>;

  constructor(worker: CalledWorker) {
    this.#calls = new WorkerCalls(worker, (bitmap) => bitmap.close());
  }

  /** Decodes one image. If nobody wants it any more when it is done, its bitmap is closed and the signal's reason thrown. */
  async decode(image: Blob, signal: AbortSignal): Promise<ImageBitmap> {
    signal.throwIfAborted();
    const bitmap = await this.#calls.call(image);
    if (signal.aborted) bitmap.close();
    signal.throwIfAborted();
    return bitmap;
  }

  dispose(): void {
    this.#calls.dispose();
  }
}
