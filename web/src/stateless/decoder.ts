/** Decodes images in a worker, called by id → promise. Whoever gets a bitmap closes it. */
import { type Deferred, deferred } from "../async/deferred";

export interface DecodeRequest {
  readonly id: number;
  readonly image: Blob;
}

export type DecodeReply =
  | { readonly id: number; readonly bitmap: ImageBitmap }
  | { readonly id: number; readonly error: string };

/** The part of Worker that is used, for tests. */
export type DecodeWorker = Pick<Worker, "postMessage" | "terminate" | "onmessage" | "onerror">;

export class Decoder {
  readonly #worker: DecodeWorker;
  readonly #waiting = new Map<number, Deferred<ImageBitmap>>();
  #nextId = 0;

  constructor(worker: DecodeWorker) {
    this.#worker = worker;
    worker.onmessage = ({ data }: MessageEvent<DecodeReply>) => this.#receive(data);
    worker.onerror = (event) => this.#fail(`The decoder failed: ${event.message}`);
  }

  /** Decodes one image. If nobody wants it any more when it is done, its bitmap is closed and the signal's reason thrown. */
  async decode(image: Blob, signal: AbortSignal): Promise<ImageBitmap> {
    signal.throwIfAborted();
    const waiting = deferred<ImageBitmap>();
    const id = this.#nextId++;
    this.#waiting.set(id, waiting);
    this.#worker.postMessage({ id, image } satisfies DecodeRequest);
    const bitmap = await waiting.promise;
    if (signal.aborted) bitmap.close();
    signal.throwIfAborted();
    return bitmap;
  }

  dispose(): void {
    this.#worker.terminate();
    this.#fail("The decoder was disposed of.");
  }

  #receive(reply: DecodeReply): void {
    const waiting = this.#waiting.get(reply.id);
    this.#waiting.delete(reply.id);
    if ("error" in reply) waiting?.reject(new Error(reply.error));
    else if (waiting === undefined) reply.bitmap.close();
    else waiting.resolve(reply.bitmap);
  }

  #fail(reason: string): void {
    const waiting = [...this.#waiting.values()];
    this.#waiting.clear();
    for (const { reject } of waiting) reject(new Error(reason));
  }
}
