/** Times the bytes of concurrent replies. */
import type { Arrival } from "./transport";

export type Clock = () => number;

/**
 * The clock starts with a packet. Bytes of a first chunk beyond one packet arrived later, at the link's rate, but were
 * delivered together: the browser hands over received data every few milliseconds. (Stream bytes in a full packet of
 * our server.)
 */
const PACKET = 1424;

/** Counts the bytes received by all replies of one transport. */
export class Receiver {
  readonly now: Clock;
  total = 0;

  constructor(now: Clock) {
    this.now = now;
  }

  begin(): Reception {
    return new Reception(this);
  }
}

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

  /** Bytes so far. The end of a stream may be reported long after its last byte, so it does not count. */
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

/** Reads a stream to its end. Aborting cancels it and makes the server stop sending. */
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
