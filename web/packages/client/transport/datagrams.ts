/** WebTransport datagrams: no retransmission, so a lost fragment costs one frame and no time. */
import { type Deferred, deferred } from "../async/deferred";
import type { RenderRequest } from "../wire/render";
import { parseFrame } from "./framing";
import { Reassembler } from "./reassembly";
import { type Clock, Receiver, type Reception } from "./reception";
import { closeQuietly, sessionEnd } from "./session";
import { FrameDropped, type FrameReply, type FrameTransport } from "./transport";

interface Pending {
  readonly reception: Reception;
  readonly reply: Deferred<FrameReply>;
}

/** A frame is lost if it has not arrived after this many round trips of the others, but not before MIN_WAIT (ms). */
const PATIENCE = 4;
const MIN_WAIT = 250;
const FIRST_WAIT = 2000;

export class DatagramTransport implements FrameTransport {
  readonly kind = "webtransport-datagrams";
  readonly maxInFlight = 32;
  readonly overtaking = true;
  readonly lost: Promise<string>;
  readonly #session: WebTransport;
  readonly #writer: WritableStreamDefaultWriter<Uint8Array>;
  readonly #receiver: Receiver;
  readonly #pending = new Map<number, Pending>();
  readonly #reassembler = new Reassembler((seq) => this.#pending.has(seq));
  #roundTrip: number | undefined;

  constructor(session: WebTransport, now: Clock) {
    this.#session = session;
    this.#receiver = new Receiver(now);
    this.#writer = datagramWriter(session.datagrams);
    this.#writer.closed.catch(() => undefined); // the session's end is reported once, by `lost`
    this.lost = sessionEnd(session);
    void this.#read(session.datagrams.readable);
  }

  async request(request: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    signal.throwIfAborted();
    const seq = request.seq ?? 0;
    const bytes = new TextEncoder().encode(JSON.stringify(request));
    const largest = this.#session.datagrams.maxDatagramSize;
    if (bytes.byteLength > largest) throw new Error(`a request of ${bytes.byteLength} bytes fits in no datagram`);
    const pending: Pending = { reception: this.#receiver.begin(), reply: deferred() };
    this.#pending.set(seq, pending);
    const wait = this.#roundTrip === undefined ? FIRST_WAIT : Math.max(MIN_WAIT, PATIENCE * this.#roundTrip);
    const timer = setTimeout(() => pending.reply.reject(new FrameDropped("the frame got lost")), wait);
    const abort = () => pending.reply.reject(signal.reason);
    signal.addEventListener("abort", abort, { once: true });
    try {
      await Promise.race([this.#writer.write(bytes), pending.reply.promise]);
      const reply = await pending.reply.promise;
      const took = reply.arrival.lastByteAt - reply.arrival.sentAt;
      this.#roundTrip = Math.max(took, 0.8 * (this.#roundTrip ?? 0));
      return reply;
    } finally {
      clearTimeout(timer);
      signal.removeEventListener("abort", abort);
      this.#pending.delete(seq);
      this.#reassembler.drop(seq);
    }
  }

  close(): void {
    closeQuietly(this.#session);
  }

  async #read(readable: ReadableStream<Uint8Array<ArrayBuffer>>): Promise<void> {
    const reader = readable.getReader();
    try {
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return;
        this.#receive(value);
      }
    } catch {
      // the session broke; `lost` reports it
    }
  }

  #receive(datagram: Uint8Array<ArrayBuffer>): void {
    if (datagram.byteLength < 4) return;
    const seq = new DataView(datagram.buffer, datagram.byteOffset).getUint32(0);
    this.#pending.get(seq)?.reception.add(datagram.byteLength);
    const whole = this.#reassembler.add(datagram);
    const pending = whole && this.#pending.get(whole.seq);
    if (whole === undefined || pending === undefined) return;
    try {
      pending.reply.resolve({ ...parseFrame(whole.chunks), arrival: pending.reception.arrival });
    } catch (error) {
      pending.reply.reject(error);
      return;
    }
    for (const [older, { reply }] of this.#pending) {
      if (older < whole.seq) reply.reject(new FrameDropped("a newer frame is complete"));
    }
  }
}

/** Browsers are moving from one writable to one per sender. */
function datagramWriter(datagrams: WebTransportDatagramDuplexStream): WritableStreamDefaultWriter<Uint8Array> {
  const both = datagrams as { writable?: WritableStream; createWritable?: () => WritableStream };
  const writable = both.writable ?? both.createWritable?.();
  if (writable === undefined) throw new Error("this browser sends no datagrams");
  return writable.getWriter();
}
