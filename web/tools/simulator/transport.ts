/** The page's transport over a simulated network: requests go up, and frames come down in one stream each. */
import { deferred } from "#client/async/deferred";
import { Receiver } from "#client/transport/reception";
import type { FrameReply, FrameTransport } from "#client/transport/transport";
import type { RenderRequest, Rung } from "#client/wire/render";
import { Bottleneck } from "./bottleneck";
import type { Endpoints } from "./endpoints";
import type { EventLoop } from "./events";
import { Sender } from "./sender";
import { type Job, Server } from "./server";
import { type NetworkTrace, TracePlayer } from "./trace";

export interface NetworkOptions {
  readonly trace: NetworkTrace;
  /** Round trip in milliseconds, instead of the trace's own delay; null keeps that. */
  readonly roundTrip: number | null;
  readonly ladder: readonly Rung[];
  readonly endpoints: Endpoints;
  readonly random: () => number;
}

/** Bytes of a request on the link. */
const REQUEST = 500;

export class SimulatedTransport implements FrameTransport {
  readonly kind = "webtransport-streams";
  readonly maxInFlight = 32;
  readonly overtaking = true;
  readonly lost = new Promise<string>(() => undefined);
  readonly #events: EventLoop;
  readonly #options: NetworkOptions;
  readonly #receiver: Receiver;
  readonly #player: TracePlayer;
  readonly #up: Bottleneck;
  readonly #server: Server;
  /** Stand-ins for the images of each rung. */
  readonly #images: readonly Blob[];
  #lastUp = 0;

  constructor(events: EventLoop, options: NetworkOptions) {
    const { trace, random } = options;
    this.#events = events;
    this.#options = options;
    this.#receiver = new Receiver(events.now);
    this.#images = options.ladder.map(() => new Blob());
    this.#player = new TracePlayer(trace);
    this.#up = new Bottleneck(trace, "up_kbps");
    const sender = new Sender(events, {
      link: new Bottleneck(trace, "down_kbps"),
      down: () => this.#delay(),
      back: (bytes, arrived) => this.#upwards(bytes, arrived),
      loses: () => random() * 100 < this.#player.at(events.now()).loss_pct,
    });
    this.#server = new Server(events, sender, options.endpoints);
  }

  request({ seq = 0, profile }: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    const { promise, resolve, reject } = deferred<FrameReply>();
    const { now } = this.#events;
    const reception = this.#receiver.begin();
    const rung = this.#options.ladder[profile ?? 0];
    let expected = Number.POSITIVE_INFINITY;
    let header: FrameReply["header"];
    const job: Job = {
      number: seq,
      rung: profile ?? 0,
      answered: (bytes, timing) => {
        expected = bytes;
        header = {
          status: 200,
          seq,
          content_type: "image/jpeg",
          timing,
          profile: profile ?? 0,
          width: rung?.width ?? 0,
          height: rung?.height ?? 0,
        };
      },
      received: (bytes) => {
        this.#events.at(this.#options.endpoints.heard(now()), () => {
          if (signal.aborted) return;
          reception.add(bytes);
          if (reception.arrival.bytes < expected) return;
          this.#events.settle();
          resolve({ header, image: this.#images[profile ?? 0] ?? NO_IMAGE, arrival: reception.arrival });
        });
      },
      refused: (problem) =>
        this.#events.at(now() + this.#delay(), () => {
          this.#events.settle();
          reject(problem);
        }),
    };
    signal.addEventListener(
      "abort",
      () => {
        this.#events.settle();
        reject(signal.reason);
        this.#upwards(REQUEST, () => this.#server.cancel(job));
      },
      { once: true },
    );
    this.#upwards(REQUEST, () => this.#server.request(job));
    return promise;
  }

  /** The rung of a received image. */
  rungOf(image: Blob): number {
    return Math.max(0, this.#images.indexOf(image));
  }

  close(): void {}

  /** Sends a small packet up. A full queue would lose it and QUIC resend it; here it waits until there is room. */
  #upwards(bytes: number, arrived: () => void): void {
    const departure = this.#up.offer(bytes, this.#events.now()) ?? this.#up.drained;
    this.#lastUp = Math.max(this.#lastUp, departure + this.#delay());
    this.#events.at(this.#lastUp, arrived);
  }

  /** Delay of one direction, without the queue. */
  #delay(): number {
    const { delay_ms, jitter_ms } = this.#player.at(this.#events.now());
    const { roundTrip, random } = this.#options;
    if (roundTrip !== null) return roundTrip / 2;
    return Math.max(0, delay_ms + jitter_ms * (2 * random() - 1));
  }
}

const NO_IMAGE = new Blob();
