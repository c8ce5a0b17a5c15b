/**
 * One QUIC connection from the server to the page, as in the render service: the oldest request's frame goes first, in
 * packets released by congestion control and pacing. A packet that finds the queue full is lost; the sender learns of
 * it when the acknowledgement would have arrived, and resends the bytes. On a lossy path without a queue, packets are
 * sent a second time when nothing else waits. The page acknowledges like Chromium: every second of the first hundred
 * packets, then every tenth, and each within a quarter of a round trip.
 */
import type { Bottleneck } from "./bottleneck";
import { PACKET, Pacer, type Packet, Westwood } from "./congestion";
import type { EventLoop } from "./events";

/** Overhead of a packet in bytes: QUIC's, and on the link also that of UDP, IP and Ethernet. */
const QUIC = 28;
const OVERHEAD = 42;
/** Bytes of an acknowledgement on the link. */
const ACKNOWLEDGEMENT = 85;
const FIRST = { packets: 2, delay: 25 };
const DECIMATED = { after: 100, packets: 10, share: 0.25 };

export interface Path {
  readonly link: Bottleneck;
  /** Delay from the link to the page, in milliseconds. */
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

/** A packet with bytes of a stream. */
interface Sent {
  readonly stream: Stream;
  readonly bytes: number;
  readonly packet: Packet;
  received: boolean;
}

export class Sender {
  readonly #events: EventLoop;
  readonly #path: Path;
  readonly #congestion = new Westwood();
  readonly #pacer = new Pacer();
  readonly #copyPacer = new Pacer();
  /** Packets worth a second copy. */
  #uncopied: Sent[] = [];
  /** Streams with something to send, oldest first. */
  #streams: Stream[] = [];
  readonly #cancelled = new WeakSet<Stream>();
  #number = 0;
  #waiting = false;
  #smoothed: number | undefined;
  #least = Number.POSITIVE_INFINITY;
  #lastArrival = 0;
  #packets = 0;
  /** Received packets not acknowledged yet. */
  #arrived: Packet[] = [];
  /** Arrival time of the last of them. */
  #arrivedAt = 0;

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
    if (this.#streams.length === 0) this.#copy(now);
  }

  #copy(now: number): void {
    if (!this.#congestion.wantsCopies(now)) this.#uncopied = [];
    for (let sent = this.#uncopied.shift(); sent !== undefined; sent = this.#uncopied.shift()) {
      if (now - sent.packet.sentAt > (this.#smoothed ?? 0)) continue;
      const at = this.#copyPacer.next(now);
      if (at > now) {
        this.#uncopied.unshift(sent);
        this.#wait(at);
        return;
      }
      this.#copyPacer.sent();
      const departure = this.#path.link.offer(sent.packet.bytes + OVERHEAD, now);
      if (departure === null || this.#path.loses()) continue;
      this.#lastArrival = Math.max(this.#lastArrival, departure + this.#path.down());
      const copied = sent;
      this.#events.at(this.#lastArrival, () => this.#received(copied));
    }
  }

  /** Handles the arrival of a packet, or of its copy, at the page. */
  #received(sent: Sent): void {
    if (sent.received) return;
    sent.received = true;
    sent.stream.received(sent.bytes);
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
    const sent = { stream, bytes, packet, received: false };
    this.#congestion.sent(packet);
    if (this.#congestion.wantsCopies(now)) this.#uncopied.push(sent);
    const departure = link.offer(packet.bytes + OVERHEAD, now);
    // Delay may vary, but packets never overtake each other: the shaper's netem and relay preserve their order.
    this.#lastArrival = Math.max(this.#lastArrival, (departure ?? link.drained) + down());
    if (departure === null || loses()) {
      this.#events.at(this.#lastArrival, () => back(ACKNOWLEDGEMENT, () => this.#lost(sent)));
      return;
    }
    this.#events.at(this.#lastArrival, () => {
      this.#received(sent);
      this.#arrives(packet);
    });
  }

  /** Acknowledges packets, in the page. */
  #arrives(packet: Packet): void {
    this.#packets++;
    this.#arrived.push(packet);
    this.#arrivedAt = this.#events.now();
    const decimated = this.#packets > DECIMATED.after;
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
    const delay = this.#events.now() - this.#arrivedAt;
    this.#arrived = [];
    this.#path.back(ACKNOWLEDGEMENT, () => this.#acknowledged(packets, delay));
  }

  /** `delay` is how long the page has held the acknowledgement of the last one. */
  #acknowledged(packets: readonly Packet[], delay: number): void {
    const now = this.#events.now();
    for (const packet of packets) this.#congestion.acknowledged(packet, now);
    const last = packets.at(-1);
    if (last !== undefined) this.#measured(now - last.sentAt, delay);
    this.#pump();
  }

  #measured(roundTrip: number, delay: number): void {
    this.#smoothed = this.#smoothed === undefined ? roundTrip : this.#smoothed + (roundTrip - this.#smoothed) / 8;
    this.#least = Math.min(this.#least, roundTrip);
    this.#congestion.measured(roundTrip, this.#events.now(), delay);
    this.#pace(this.#smoothed);
  }

  #pace(roundTrip: number): void {
    for (const pacer of [this.#pacer, this.#copyPacer]) pacer.update(this.#congestion.window, roundTrip);
  }

  #lost(sent: Sent): void {
    const { stream, bytes, packet } = sent;
    this.#congestion.lost(packet, this.#events.now());
    if (this.#smoothed !== undefined) this.#pace(this.#smoothed);
    if (sent.received) {
      this.#pump();
      return;
    }
    stream.remaining += bytes;
    this.#queue(stream);
    this.#pump();
  }
}
