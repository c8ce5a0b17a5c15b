/**
 * The server's side of one QUIC connection: frames are streams whose packets take turns, in flight at most a congestion window
 * of NewReno (RFC 9002, appendix B; aioquic's default). A packet that finds the queue full is lost; the sender hears of it when
 * an acknowledgement would have come, and sends the bytes again.
 */
import type { Bottleneck } from "./bottleneck";
import type { EventLoop } from "./events";

/** Payload bytes of a packet, and what headers of QUIC, UDP, IP and Ethernet add on the link. */
const PACKET = 1200;
const OVERHEAD = 64;
const INITIAL_WINDOW = 10 * PACKET;
const MIN_WINDOW = 2 * PACKET;

export interface Path {
  readonly link: Bottleneck;
  /** Milliseconds from the link to the client, and from there back to the sender. */
  readonly down: () => number;
  readonly up: () => number;
  /** Whether a packet gets lost at random. */
  readonly loses: () => boolean;
}

export interface Stream {
  /** Bytes still to be sent. */
  remaining: number;
  readonly received: (bytes: number) => void;
}

export class Sender {
  readonly #events: EventLoop;
  readonly #path: Path;
  #streams: Stream[] = [];
  #window = INITIAL_WINDOW;
  #threshold = Number.POSITIVE_INFINITY;
  #inFlight = 0;
  #recoverySince = Number.NEGATIVE_INFINITY;
  #lastArrival = 0;

  constructor(events: EventLoop, path: Path) {
    this.#events = events;
    this.#path = path;
  }

  send(stream: Stream): void {
    this.#streams.push(stream);
    this.#pump();
  }

  /** Forget what was not sent yet. */
  cancel(stream: Stream): void {
    stream.remaining = 0;
    this.#streams = this.#streams.filter((other) => other !== stream);
  }

  #pump(): void {
    while (this.#inFlight + PACKET <= this.#window) {
      const stream = this.#streams.shift();
      if (stream === undefined) return;
      const bytes = Math.min(PACKET, stream.remaining);
      stream.remaining -= bytes;
      if (stream.remaining > 0) this.#streams.push(stream);
      this.#packet(stream, bytes);
    }
  }

  #packet(stream: Stream, bytes: number): void {
    const { link, down, up, loses } = this.#path;
    const now = this.#events.now();
    this.#inFlight += bytes;
    const departure = link.offer(bytes + OVERHEAD, now);
    // Delay may vary, but packets never overtake each other: the shaper's netem and relay keep their order.
    this.#lastArrival = Math.max(this.#lastArrival, (departure ?? link.drained) + down());
    const heardAt = this.#lastArrival + up();
    if (departure === null || loses()) {
      this.#events.at(heardAt, () => this.#lost(stream, bytes, now));
      return;
    }
    this.#events.at(this.#lastArrival, () => stream.received(bytes));
    this.#events.at(heardAt, () => this.#acknowledged(bytes, now));
  }

  #acknowledged(bytes: number, sentAt: number): void {
    const limited = this.#inFlight + PACKET > this.#window;
    this.#inFlight -= bytes;
    if (limited && sentAt > this.#recoverySince) {
      this.#window += this.#window < this.#threshold ? bytes : (PACKET * bytes) / this.#window;
    }
    this.#pump();
  }

  #lost(stream: Stream, bytes: number, sentAt: number): void {
    this.#inFlight -= bytes;
    if (sentAt > this.#recoverySince) {
      this.#recoverySince = this.#events.now();
      this.#threshold = Math.max(MIN_WINDOW, this.#window / 2);
      this.#window = this.#threshold;
    }
    stream.remaining += bytes;
    if (!this.#streams.includes(stream)) this.#streams.unshift(stream);
    this.#pump();
  }
}
