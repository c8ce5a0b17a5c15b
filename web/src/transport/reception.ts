/** Times the bytes of replies that come in side by side. */
import type { Arrival } from "./transport";

export type Clock = () => number;

/** Counts what all replies of one transport receive. */
export class Receiver {
  readonly now: Clock;
  total = 0;

  constructor(now: Clock) {
    this.now = now;
  }

  /** Starts the clock of one request. */
  begin(): Reception {
    return new Reception(this);
  }
}

/** The bytes of one reply. */
export class Reception {
  readonly #receiver: Receiver;
  readonly #sentAt: number;
  #firstByteAt: number | undefined;
  #totalAtFirst = 0;
  #bytes = 0;

  constructor(receiver: Receiver) {
    this.#receiver = receiver;
    this.#sentAt = receiver.now();
  }

  add(bytes: number): void {
    this.#receiver.total += bytes;
    this.#bytes += bytes;
    if (this.#firstByteAt === undefined) {
      this.#firstByteAt = this.#receiver.now();
      this.#totalAtFirst = this.#receiver.total;
    }
  }

  finish(): Arrival {
    const lastByteAt = this.#receiver.now();
    return {
      sentAt: this.#sentAt,
      firstByteAt: this.#firstByteAt ?? lastByteAt,
      lastByteAt,
      bytes: this.#bytes,
      sharedBytes: this.#firstByteAt === undefined ? 0 : this.#receiver.total - this.#totalAtFirst,
    };
  }
}

/** Reads a stream to its end. Aborting cancels it, which tells the server to stop sending. */
export async function readAll(
  stream: ReadableStream<Uint8Array<ArrayBuffer>>,
  reception: Reception,
  signal: AbortSignal,
): Promise<Uint8Array<ArrayBuffer>[]> {
  const reader = stream.getReader();
  const cancel = () => void reader.cancel(signal.reason).catch(() => undefined);
  signal.addEventListener("abort", cancel, { once: true });
  try {
    if (signal.aborted) cancel();
    const chunks: Uint8Array<ArrayBuffer>[] = [];
    for (;;) {
      const { done, value } = await reader.read();
      signal.throwIfAborted();
      if (done) return chunks;
      reception.add(value.byteLength);
      chunks.push(value);
    }
  } finally {
    signal.removeEventListener("abort", cancel);
  }
}
