/** The page's side of the frame worker: transports whose sessions and decoding are in the worker. */
import { type Deferred, deferred } from "../async/deferred";
import type { CalledWorker } from "../async/worker-calls";
import type { SessionOptions } from "../transport/session";
import type { DecodedImage, FrameReply, FrameTransport } from "../transport/transport";
import type { RenderRequest } from "../wire/render";
import { errorOf, type FromWorker, type SessionKind, type ToWorker } from "./messages";

type Opened = Extract<FromWorker, { kind: "opened" }>;

/** A call in progress; a request first awaits its reply, and then its picture. */
interface Call {
  readonly opened?: Deferred<Opened>;
  readonly reply?: Deferred<FrameReply>;
  readonly picture?: Deferred<DecodedImage>;
}

export class FrameWorker {
  readonly #worker: CalledWorker;
  readonly #calls = new Map<number, Call>();
  readonly #sessions = new Map<number, (reason: string) => void>();
  #nextId = 0;
  #failed: Error | undefined;

  constructor(worker: CalledWorker = startWorker()) {
    this.#worker = worker;
    worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.#receive(data);
    worker.onerror = (event) => this.#fail(new Error(event.message || "a worker could not be started"));
  }

  /** A transport over a new session. Rejects as `openSession` does. */
  async open(kind: SessionKind, options: SessionOptions, signal: AbortSignal): Promise<FrameTransport> {
    signal.throwIfAborted();
    const opened = deferred<Opened>();
    const id = this.#call({ opened });
    const lost = deferred<string>();
    this.#sessions.set(id, lost.resolve);
    this.#post({ kind: "open", id, transport: kind, options, timeOrigin: performance.timeOrigin });
    const abort = () => {
      this.#post({ kind: "abort", id });
      opened.reject(signal.reason);
    };
    signal.addEventListener("abort", abort, { once: true });
    const close = () => this.#post({ kind: "close", session: id });
    try {
      const { maxInFlight, overtaking } = await opened.promise;
      const request: FrameTransport["request"] = (view, stop) => this.#request(id, view, stop);
      return { kind, maxInFlight, overtaking, lost: lost.promise, request, close };
    } catch (error) {
      this.#sessions.delete(id);
      close(); // it may have been opened meanwhile
      throw error;
    } finally {
      signal.removeEventListener("abort", abort);
    }
  }

  /** A picture received by other means. */
  decode(image: Blob): Promise<DecodedImage> {
    const picture = deferred<DecodedImage>();
    this.#post({ kind: "decode", id: this.#call({ picture }), image });
    return picture.promise;
  }

  /** Closes all sessions and ends the worker. */
  dispose(): void {
    this.#post({ kind: "end" });
    this.#fail(new Error("the viewer was closed"));
  }

  async #request(session: number, request: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    signal.throwIfAborted();
    const [reply, picture] = [deferred<FrameReply>(), deferred<DecodedImage>()];
    picture.promise.catch(() => undefined); // handled where it is shown
    const id = this.#call({ reply, picture });
    this.#post({ kind: "request", id, session, request });
    const abort = () => {
      this.#calls.delete(id);
      this.#post({ kind: "abort", id });
      reply.reject(signal.reason);
    };
    signal.addEventListener("abort", abort, { once: true });
    try {
      const received = await reply.promise;
      return received.header.video ? received : { ...received, picture: picture.promise };
    } finally {
      signal.removeEventListener("abort", abort);
    }
  }

  #call(call: Call): number {
    const id = this.#nextId++;
    this.#calls.set(id, call);
    if (this.#failed) this.#reject(id, this.#failed);
    return id;
  }

  #post(message: ToWorker): void {
    if (this.#failed === undefined) this.#worker.postMessage(message);
  }

  #receive(message: FromWorker): void {
    switch (message.kind) {
      case "opened":
        this.#take(message.id)?.opened?.resolve(message);
        break;
      case "reply":
        this.#calls.get(message.id)?.reply?.resolve(message.reply);
        if (message.reply.header.video) this.#calls.delete(message.id);
        break;
      case "picture": {
        const picture = this.#take(message.id)?.picture;
        if (picture) picture.resolve(message.picture);
        else message.picture.bitmap.close(); // aborted meanwhile
        break;
      }
      case "failed":
        this.#reject(message.id, errorOf(message.failure));
        break;
      case "lost":
        this.#sessions.get(message.session)?.(message.reason);
        this.#sessions.delete(message.session);
    }
  }

  #take(id: number): Call | undefined {
    const call = this.#calls.get(id);
    this.#calls.delete(id);
    return call;
  }

  #reject(id: number, error: Error): void {
    const call = this.#take(id);
    call?.opened?.reject(error);
    call?.reply?.reject(error);
    call?.picture?.reject(error);
  }

  #fail(error: Error): void {
    this.#failed ??= error;
    for (const id of [...this.#calls.keys()]) this.#reject(id, error);
    for (const lose of this.#sessions.values()) lose(`The connection was closed: ${error.message}.`);
    this.#sessions.clear();
  }
}

function startWorker(): CalledWorker {
  return new Worker(new URL("./frame.worker.ts", import.meta.url), { type: "module", name: "frames" });
}
