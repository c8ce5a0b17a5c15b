/** For tests: a worker that decodes each frame at once, or fails on demand. */
import type { CalledWorker, WorkerAnswer, WorkerCall } from "#client/async/worker-calls";
import type { EncodedFrame } from "#viewer/video/encoded-frame";

export class FakeDecoder implements CalledWorker {
  onmessage: CalledWorker["onmessage"] = null;
  onerror: CalledWorker["onerror"] = null;
  readonly decoded: EncodedFrame[] = [];
  readonly pictures: (ImageBitmap & { closed: boolean })[] = [];
  /** Error of all further frames. */
  failure: { readonly name: string; readonly message: string } | null = null;
  terminated = false;

  postMessage({ id, request }: WorkerCall<EncodedFrame>): void {
    this.decoded.push(request);
    if (this.failure) {
      this.#answer({ id, error: this.failure });
      return;
    }
    const picture = { width: 2, height: 2, closed: false, close: () => Object.assign(picture, { closed: true }) };
    this.pictures.push(picture as unknown as ImageBitmap & { closed: boolean });
    this.#answer({ id, value: picture as unknown as ImageBitmap });
  }

  terminate(): void {
    this.terminated = true;
  }

  #answer(data: WorkerAnswer<ImageBitmap>): void {
    this.onmessage?.call(this as unknown as Worker, { data } as MessageEvent);
  }
}
