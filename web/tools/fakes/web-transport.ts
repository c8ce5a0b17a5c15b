/** A WebTransport session for tests: streams and datagrams that the test answers. */
import { type Deferred, deferred } from "#client/async/deferred";

export interface FakeStream {
  /** The client's bytes, once it has closed its side. */
  readonly request: Promise<string>;
  respond(...chunks: Uint8Array[]): void;
  readonly stopped: Promise<void>;
}

export class FakeSession {
  readonly ready: Promise<void>;
  readonly closed: Promise<WebTransportCloseInfo>;
  readonly opened = deferred<void>();
  readonly ended: Deferred<WebTransportCloseInfo> = deferred();
  readonly streams: FakeStream[] = [];
  readonly sent: string[] = [];
  closes = 0;
  readonly datagrams: { maxDatagramSize: number; readable: ReadableStream; writable: WritableStream };
  #deliver: ReadableStreamDefaultController<Uint8Array> | undefined;

  constructor({ maxDatagramSize = 1200 } = {}) {
    this.ready = this.opened.promise;
    this.closed = this.ended.promise;
    this.datagrams = {
      maxDatagramSize,
      readable: new ReadableStream({
        start: (controller) => {
          this.#deliver = controller;
        },
      }),
      writable: new WritableStream({
        write: (bytes: Uint8Array) => {
          this.sent.push(new TextDecoder().decode(bytes));
        },
      }),
    };
  }

  deliver(datagram: Uint8Array): void {
    this.#deliver?.enqueue(datagram);
  }

  close(): void {
    this.closes++;
    this.ended.resolve({ closeCode: 0, reason: "" });
  }

  async createBidirectionalStream(): Promise<WebTransportBidirectionalStream> {
    const request = deferred<string>();
    const stopped = deferred<void>();
    let controller: ReadableStreamDefaultController<Uint8Array> | undefined;
    let written = "";
    const readable = new ReadableStream<Uint8Array>({
      start: (given) => {
        controller = given;
      },
      cancel: () => stopped.resolve(),
    });
    const writable = new WritableStream<Uint8Array>({
      write: (bytes) => {
        written += new TextDecoder().decode(bytes);
      },
      close: () => request.resolve(written),
    });
    this.streams.push({
      request: request.promise,
      stopped: stopped.promise,
      respond: (...chunks) => {
        for (const chunk of chunks) controller?.enqueue(chunk);
        controller?.close();
      },
    });
    return { readable, writable } as unknown as WebTransportBidirectionalStream;
  }

  get session(): WebTransport {
    return this as unknown as WebTransport;
  }
}
