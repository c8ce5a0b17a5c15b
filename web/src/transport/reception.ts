/** Times the bytes of replies that come in side by side. */
import type { Arrival } from "./transport";

export type Clock = () => number;

/**
 * The clock starts with a packet. What a first chunk has beyond one came after it, as fast as it was, and was only heard of at
 * once: the browser hands on what has arrived every few milliseconds. (Bytes of a stream in a full packet of ours.)
 */
const PACKET = 1424;

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
  #lastByteAt = 0;
  #totalAtFirst = 0;
  #totalAtLast = 0;
  #bytes = 0;

  constructor(receiver: Receiver) {
    this.#receiver = receiver;
    this.#sentAt = receiver.now();
  }

  add(bytes: number): void {
    this.#receiver.total += bytes;
    this.#bytes += bytes;
    this.#lastByteAt = this.#receiver.now();
    this.#totalAtLast = this.#receiver.total;
    if (this.#firstByteAt === undefined) {
      this.#firstByteAt = this.#lastByteAt;
      this.#totalAtFirst = this.#totalAtLast - Math.max(0, bytes - PACKET);
    }
  }

  /** What has come until now. A stream's end may be heard of long after its last byte, so it does not count. */
  get arrival(): Arrival {
    return {
      sentAt: this.#sentAt,
      firstByteAt: this.#firstByteAt ?? this.#sentAt,
      lastByteAt: this.#firstByteAt === undefined ? this.#sentAt : this.#lastByteAt,
      bytes: this.#bytes,
      sharedBytes: this.#totalAtLast - this.#totalAtFirst,
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
