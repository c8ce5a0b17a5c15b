/** WebTransport, one bidirectional stream per frame: no head-of-line blocking, and a stale frame can be cancelled. */
import type { RenderRequest } from "../wire/render";
import { parseFrame } from "./framing";
import { type Clock, Receiver, readAll } from "./reception";
import { closeQuietly, sessionEnd } from "./session";
import type { FrameReply, FrameTransport } from "./transport";

export class StreamTransport implements FrameTransport {
  readonly kind = "webtransport-streams";
  readonly maxInFlight = 32;
  readonly overtaking = true;
  readonly lost: Promise<string>;
  readonly #session: WebTransport;
  readonly #receiver: Receiver;

  constructor(session: WebTransport, now: Clock) {
    this.#session = session;
    this.#receiver = new Receiver(now);
    this.lost = sessionEnd(session);
  }

  async request(request: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    signal.throwIfAborted();
    const reception = this.#receiver.begin();
    const stream: WebTransportBidirectionalStream = await this.#session.createBidirectionalStream();
    // Reading starts first, so that an abort reaches the server even while the request is on its way.
    const reply = readAll(stream.readable, reception, signal);
    const [chunks] = await Promise.all([reply, send(stream.writable, request)]);
    return { ...parseFrame(chunks), arrival: reception.arrival };
  }

  close(): void {
    closeQuietly(this.#session);
  }
}

async function send(writable: WritableStream, request: RenderRequest): Promise<void> {
  const writer = writable.getWriter();
  writer.closed.catch(() => undefined); // reported by write and close
  await writer.write(new TextEncoder().encode(JSON.stringify(request)));
  await writer.close();
}
