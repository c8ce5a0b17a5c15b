/** Fetches a live stream segment by segment, each while it grows, with the next one already requested. */
import { sleep } from "#client/async/retry";
import { StreamEnded } from "../stream/stream";
import { affordable, DeliveryRate } from "./delivery-rate";
import type { Manifest, Representation } from "./manifest";

/** Seconds before its start at which the next segment is requested; the server answers at its start. */
const LEAD = 0.5;
/** Number of retries of a failed request, and the milliseconds between them. */
const RETRIES = 4;
const RETRY_AFTER = 250;

export interface FeedOptions {
  readonly manifest: Manifest;
  /** The server's position on the media timeline, in seconds. */
  readonly live: () => number;
  readonly onBytes: (bytes: Uint8Array<ArrayBuffer>) => void;
  /** Called when the rest of the current segment will not arrive; another one follows. */
  readonly onInterrupted: () => void;
  readonly onReceived: (bytes: number) => void;
}

interface Opened {
  readonly representation: Representation;
  readonly body: ReadableStreamDefaultReader<Uint8Array<ArrayBuffer>>;
}

export class SegmentFeed {
  readonly #options: FeedOptions;
  readonly #rate = new DeliveryRate();
  readonly #headers = new Map<string, Uint8Array<ArrayBuffer>>();
  /** Failed requests since the last received bytes. */
  #failures = 0;

  constructor(options: FeedOptions) {
    this.#options = options;
  }

  /** Feeds until the signal is aborted. Rejects with StreamEnded at the end of the stream. */
  async run(signal: AbortSignal): Promise<never> {
    for (;;) {
      const visit = new AbortController();
      try {
        await this.#follow(AbortSignal.any([signal, visit.signal]));
      } catch (error) {
        signal.throwIfAborted();
        if (error instanceof StreamEnded) throw error;
        if (++this.#failures > RETRIES) throw new StreamEnded("The DASH stream was interrupted.");
        await sleep(RETRY_AFTER, signal);
      } finally {
        visit.abort();
      }
      this.#options.onInterrupted();
    }
  }

  /** Feeds from the segment that is currently growing, until it is too far behind. */
  async #follow(signal: AbortSignal): Promise<void> {
    const { onBytes, onReceived } = this.#options;
    let shown: Representation | undefined;
    let number = this.#growing();
    for (let next = this.#open(number, signal); ; number++) {
      const { representation, body } = await next;
      next = this.#openInTime(number + 1, signal);
      next.catch(() => undefined); // reported where it is awaited
      if (representation !== shown) onBytes(await this.#header(representation, signal));
      shown = representation;
      this.#rate.begin();
      for (let read = await body.read(); !read.done; read = await body.read()) {
        this.#failures = 0;
        this.#rate.received(read.value, performance.now());
        onReceived(read.value.length);
        onBytes(read.value);
        if (this.#growing() > number + 1) return;
      }
    }
  }

  /** The segment that the server is currently making. */
  #growing(): number {
    const { manifest, live } = this.#options;
    return manifest.firstNumber + Math.max(0, Math.floor(live() / manifest.segment));
  }

  async #openInTime(number: number, signal: AbortSignal): Promise<Opened> {
    const { manifest, live } = this.#options;
    const begins = (number - manifest.firstNumber) * manifest.segment;
    await sleep(Math.max(0, begins - LEAD - live()) * 1000, signal);
    return this.#open(number, signal);
  }

  async #open(number: number, signal: AbortSignal): Promise<Opened> {
    const { manifest } = this.#options;
    const representation = affordable(manifest.representations, this.#rate.bitsPerSecond(performance.now()));
    const { body } = await fetched(manifest.segmentUrl(representation, number), signal);
    if (body === null) throw new StreamEnded("The DASH stream is empty.");
    return { representation, body: body.getReader() };
  }

  /** Requests an initialisation segment once. */
  async #header(representation: Representation, signal: AbortSignal): Promise<Uint8Array<ArrayBuffer>> {
    const known = this.#headers.get(representation.id);
    if (known !== undefined) return known;
    const response = await fetched(this.#options.manifest.headerUrl(representation), signal);
    const header = new Uint8Array(await response.arrayBuffer());
    this.#headers.set(representation.id, header);
    return header;
  }
}

/** A successful response. Rejects with StreamEnded if the session has ended. */
export async function fetched(url: string, signal: AbortSignal): Promise<Response> {
  const response = await fetch(url, { signal, cache: "no-store" });
  if (!response.ok) throw new StreamEnded("The DASH stream has ended.");
  return response;
}
