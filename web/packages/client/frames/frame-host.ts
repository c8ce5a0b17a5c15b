/** The worker's side: sessions to the server, and the pictures of their frames. */
import { DatagramTransport } from "../transport/datagrams";
import type { Clock } from "../transport/reception";
import { openSession, type SessionOptions } from "../transport/session";
import { StreamTransport } from "../transport/streams";
import type { DecodedImage, FrameTransport } from "../transport/transport";
import { type FromWorker, failureOf, type SessionKind, type ToWorker } from "./messages";

export interface HostOptions {
  readonly post: (message: FromWorker, transfer: Transferable[]) => void;
  readonly decode: (image: Blob) => Promise<DecodedImage>;
  readonly open?: (
    kind: SessionKind,
    options: SessionOptions,
    signal: AbortSignal,
    now: Clock,
  ) => Promise<FrameTransport>;
}

type Request = Extract<ToWorker, { kind: "request" }>;

export class FrameHost {
  readonly #post: HostOptions["post"];
  readonly #decode: HostOptions["decode"];
  readonly #open: NonNullable<HostOptions["open"]>;
  readonly #sessions = new Map<number, FrameTransport>();
  /** Aborts calls in progress, by id. */
  readonly #aborts = new Map<number, AbortController>();

  constructor({ post, decode, open = openTransport }: HostOptions) {
    this.#post = post;
    this.#decode = decode;
    this.#open = open;
  }

  receive(message: ToWorker): void {
    switch (message.kind) {
      case "open": {
        const { id, transport, options, timeOrigin } = message;
        const now = () => performance.timeOrigin - timeOrigin + performance.now();
        this.#work(id, async (signal) => this.#opened(id, await this.#open(transport, options, signal, now), signal));
        break;
      }
      case "request":
        this.#work(message.id, (signal) => this.#request(message, signal));
        break;
      case "decode":
        this.#work(message.id, () => this.#picture(message.id, message.image));
        break;
      case "abort":
        this.#aborts.get(message.id)?.abort(new Error("the page no longer wants it"));
        break;
      case "close":
        this.#sessions.get(message.session)?.close();
        this.#sessions.delete(message.session);
        break;
      case "end":
        for (const session of this.#sessions.values()) session.close();
        this.#sessions.clear();
    }
  }

  #work(id: number, work: (signal: AbortSignal) => Promise<void>): void {
    const abort = new AbortController();
    this.#aborts.set(id, abort);
    work(abort.signal)
      .catch((error: unknown) => this.#post({ kind: "failed", id, failure: failureOf(error) }, []))
      .finally(() => this.#aborts.delete(id));
  }

  #opened(id: number, transport: FrameTransport, signal: AbortSignal): void {
    if (signal.aborted) transport.close();
    signal.throwIfAborted();
    this.#sessions.set(id, transport);
    void transport.lost.then((reason) => {
      this.#sessions.delete(id);
      this.#post({ kind: "lost", session: id, reason }, []);
    });
    const { maxInFlight, overtaking } = transport;
    this.#post({ kind: "opened", id, maxInFlight, overtaking }, []);
  }

  async #request({ id, session, request }: Request, signal: AbortSignal): Promise<void> {
    const transport = this.#sessions.get(session);
    if (transport === undefined) throw new Error("the session has ended");
    const reply = await transport.request(request, signal);
    this.#post({ kind: "reply", id, reply }, []);
    if (!reply.header.video) await this.#picture(id, reply.image);
  }

  async #picture(id: number, image: Blob): Promise<void> {
    const picture = await this.#decode(image);
    const { bitmap, depth } = picture;
    this.#post({ kind: "picture", id, picture }, depth === null ? [bitmap] : [bitmap, depth.codes.buffer]);
  }
}

async function openTransport(
  kind: SessionKind,
  options: SessionOptions,
  signal: AbortSignal,
  now: Clock,
): Promise<FrameTransport> {
  const session = await openSession(options, signal);
  return kind === "webtransport-datagrams" ? new DatagramTransport(session, now) : new StreamTransport(session, now);
}
