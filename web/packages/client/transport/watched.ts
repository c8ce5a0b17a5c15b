/** A transport that detects a silent server: requests are outstanding and no answer arrives. */
import { sleep } from "../async/retry";
import type { RenderRequest } from "../wire/render";
import type { Clock } from "./reception";
import { type FrameReply, type FrameTransport, RequestProblem, type TransportKind } from "./transport";

/** A server is silent after this many times the longest recent response time, at least MIN_PATIENCE (ms). */
const ANSWERS = 8;
export const MIN_PATIENCE = 2000;
/** Interval of probes of a silent server, in milliseconds: the first packets after an outage wake a connection up. */
const PROBE_EVERY = 500;
/** A request that is refused at once, without loading a scene or queueing. */
const PROBE: RenderRequest = { scene: "", seq: 2 ** 32 - 1, fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 };

export class WatchedTransport implements FrameTransport {
  readonly kind: TransportKind;
  readonly maxInFlight: number;
  readonly overtaking: boolean;
  readonly lost: Promise<string>;
  readonly #transport: FrameTransport;
  readonly #now: Clock;
  /** Time of the first request since the last answer; undefined without outstanding requests. */
  #unansweredSince: number | undefined;
  #outstanding = 0;
  #answers = 0;
  /** The longest recent response time, in milliseconds. */
  #usual = 0;

  constructor(transport: FrameTransport, now: Clock) {
    this.#transport = transport;
    this.#now = now;
    this.kind = transport.kind;
    this.maxInFlight = transport.maxInFlight;
    this.overtaking = transport.overtaking;
    this.lost = transport.lost;
  }

  async request(request: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    const sentAt = this.#now();
    this.#outstanding++;
    this.#unansweredSince ??= sentAt;
    try {
      const reply = await this.#transport.request(request, signal);
      this.#answered(sentAt);
      return reply;
    } catch (error) {
      if (error instanceof RequestProblem) this.#answered(sentAt);
      throw error;
    } finally {
      this.#outstanding--;
      if (this.#outstanding === 0 && signal.aborted) this.#unansweredSince = undefined; // no requests are left
    }
  }

  /** Time since the first unanswered request, in milliseconds. */
  get quietFor(): number {
    return this.#unansweredSince === undefined ? 0 : this.#now() - this.#unansweredSince;
  }

  /** Whether the current silence is unusually long. */
  get silent(): boolean {
    return this.quietFor > this.#patience;
  }

  /** Probes the server; resolves to whether any answer arrived in time. */
  async probe(signal: AbortSignal): Promise<boolean> {
    const enough = new AbortController();
    const before = this.#answers;
    const end = this.#now() + this.#patience;
    try {
      while (this.#answers === before && this.#now() < end) {
        this.request(PROBE, AbortSignal.any([signal, enough.signal])).catch(() => undefined);
        await sleep(PROBE_EVERY, signal);
      }
    } finally {
      enough.abort(new Error("there has been an answer, or none in time"));
    }
    return this.#answers !== before;
  }

  close(): void {
    this.#transport.close();
  }

  get #patience(): number {
    return Math.max(MIN_PATIENCE, ANSWERS * this.#usual);
  }

  #answered(sentAt: number): void {
    const now = this.#now();
    this.#answers++;
    this.#usual = Math.max(now - sentAt, 0.8 * this.#usual);
    this.#unansweredSince = this.#outstanding > 1 ? now : undefined;
  }
}
