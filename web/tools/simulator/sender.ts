/**
 * One QUIC connection from the server to the page, as in the render service: the oldest request's frame goes first, in
 * packets released by congestion control and pacing. A packet that finds the queue full is lost; the sender learns of
 * it when the acknowledgement would have arrived, and sends the bytes again. The page acknowledges like Chromium: every
 * second of the first hundred packets, then every tenth, and none later than a quarter of a round trip.
 */
import type { Bottleneck } from "./bottleneck";
import { PACKET, Pacer, type Packet, Westwood } from "./congestion";
import type { EventLoop } from "./events";

/** Bytes of a packet that are not a frame's: QUIC's, and on the link UDP's, IP's and Ethernet's as well. */
const QUIC = 28;
const OVERHEAD = 42;
/** Bytes of an acknowledgement on the link. */
const ACKNOWLEDGEMENT = 85;
const FIRST = { packets: 2, delay: 25 };
const DECIMATED = { after: 100, packets: 10, share: 0.25 };

export interface Path {
  readonly link: Bottleneck;
  /** Milliseconds from the link to the page. */
  readonly down: () => number;
  /** Sends bytes from the page to the sender. */
  readonly back: (bytes: number, arrived: () => void) => void;
  /** Whether a packet gets lost at random. */
  readonly loses: () => boolean;
}

export interface Stream {
  /** Streams are sent in this order. */
  readonly number: number;
  /** Bytes still to be sent. */
  remaining: number;
  readonly received: (bytes: number) => void;
}

export class Sender {
  readonly #events: EventLoop;
  readonly #path: Path;
  readonly #congestion = new Westwood();
  readonly #pacer = new Pacer();
  /** Those with something to send, the oldest first. */
  #streams: Stream[] = [];
  readonly #cancelled = new WeakSet<Stream>();
  #number = 0;
  #waiting = false;
  #smoothed: number | undefined;
  #least = Number.POSITIVE_INFINITY;
  #lastArrival = 0;
  #received = 0;
  /** Received packets not acknowledged yet. */
  #arrived: Packet[] = [];

  constructor(events: EventLoop, path: Path) {
    this.#events = events;
    this.#path = path;
  }

  send(stream: Stream): void {
    this.#queue(stream);
    this.#pump();
  }

  /** Drops all unsent bytes. */
  cancel(stream: Stream): void {
    this.#cancelled.add(stream);
    this.#streams = this.#streams.filter((other) => other !== stream);
  }

  #queue(stream: Stream): void {
    if (this.#cancelled.has(stream) || this.#streams.includes(stream)) return;
    const at = this.#streams.findIndex(({ number }) => number > stream.number);
    this.#streams.splice(at < 0 ? this.#streams.length : at, 0, stream);
  }

  #pump(): void {
    const now = this.#events.now();
    for (let [stream] = this.#streams; stream !== undefined && this.#congestion.room; [stream] = this.#streams) {
      const at = this.#pacer.next(now);
      if (at > now) {
        this.#wait(at);
        return;
      }
      const bytes = Math.min(PACKET - QUIC, stream.remaining);
      stream.remaining -= bytes;
      if (stream.remaining <= 0) this.#streams.shift();
      this.#packet(stream, bytes);
      this.#pacer.sent();
    }
  }

  #wait(until: number): void {
    if (this.#waiting) return;
    this.#waiting = true;
    this.#events.at(until, () => {
      this.#waiting = false;
      this.#pump();
    });
  }

  #packet(stream: Stream, bytes: number): void {
    const { link, down, back, loses } = this.#path;
    const now = this.#events.now();
    const packet = { number: this.#number++, bytes: bytes + QUIC, sentAt: now };
    this.#congestion.sent(packet);
    const departure = link.offer(packet.bytes + OVERHEAD, now);
    // Delay may vary, but packets never overtake each other: the shaper's netem and relay keep their order.
    this.#lastArrival = Math.max(this.#lastArrival, (departure ?? link.drained) + down());
    if (departure === null || loses()) {
      this.#events.at(this.#lastArrival, () => back(ACKNOWLEDGEMENT, () => this.#lost(stream, bytes, packet)));
      return;
    }
    this.#events.at(this.#lastArrival, () => {
      stream.received(bytes);
      this.#arrives(packet);
    });
  }

  /** In the page. */
  #arrives(packet: Packet): void {
    this.#received++;
    this.#arrived.push(packet);
    const decimated = this.#received > DECIMATED.after;
    if (this.#arrived.length >= (decimated ? DECIMATED.packets : FIRST.packets)) {
      this.#acknowledge();
    } else if (this.#arrived.length === 1) {
      const delay = decimated ? Math.min(FIRST.delay, Math.max(1, this.#least * DECIMATED.share)) : FIRST.delay;
      this.#events.at(this.#events.now() + delay, () => {
        if (this.#arrived[0] === packet) this.#acknowledge();
      });
    }
  }

  #acknowledge(): void {
    const packets = this.#arrived;
    this.#arrived = [];
    this.#path.back(ACKNOWLEDGEMENT, () => this.#acknowledged(packets));
  }

  #acknowledged(packets: readonly Packet[]): void {
    const now = this.#events.now();
    for (const packet of packets) this.#congestion.acknowledged(packet, now);
    const last = packets.at(-1);
    if (last !== undefined) this.#measured(now - last.sentAt);
    this.#pump();
  }

  #measured(roundTrip: number): void {
    this.#smoothed = this.#smoothed === undefined ? roundTrip : this.#smoothed + (roundTrip - this.#smoothed) / 8;
    this.#least = Math.min(this.#least, roundTrip);
    this.#congestion.measured(roundTrip, this.#events.now());
    this.#pacer.update(this.#congestion.window, this.#smoothed);
  }

  #lost(stream: Stream, bytes: number, packet: Packet): void {
    this.#congestion.lost(packet, this.#events.now());
    if (this.#smoothed !== undefined) this.#pacer.update(this.#congestion.window, this.#smoothed);
    stream.remaining += bytes;
    this.#queue(stream);
    this.#pump();
  }
}
