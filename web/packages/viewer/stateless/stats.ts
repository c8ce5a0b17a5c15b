/** Figures of the stateless mode for the HUD, from its own measurements and from requests and answers. */
import { ThroughputEstimator } from "#client/abr/throughput";
import type { FrameReply, TransportKind } from "#client/transport/transport";
import type { ServerTiming } from "#client/wire/render";
import { type Figures, NO_FIGURES } from "../view/meter";
import { TimeWindow } from "../view/window";
import type { PipelineCounts } from "./pipeline";

/** Figures from the answers alone. */
export interface ReplyStats {
  /** From sending a request to its frame's last byte, median of the last seconds, in milliseconds. */
  readonly roundTrip: number | null;
  /** Breakdown of the server's time, as medians like the round trip, in milliseconds. */
  readonly server: ServerTiming | null;
  /** Whether, with a moving camera, the server accounts for most of the response time. */
  readonly serverBound: boolean;
  readonly throughput: number | null;
  readonly frame: {
    readonly bytes: number;
    readonly width: number | null;
    readonly height: number | null;
    readonly profile: number | null;
    readonly webp?: boolean;
  } | null;
}

export interface VideoStats {
  /** Requested rate in bits per second. */
  readonly bitrate: number;
  /** Key frames received over this connection. */
  readonly keyFrames: number;
}

export interface Stats extends Figures, ReplyStats {
  readonly kind: "requests";
  /** Null if each answer is an independent picture. */
  readonly video: VideoStats | null;
  readonly transport: TransportKind | null;
  /** The graphics processor's time to enhance a frame, median of the last seconds; null while none is enhanced. In milliseconds. */
  readonly enhanceMs: number | null;
  readonly inFlight: number;
  readonly counts: PipelineCounts;
}

export const NO_STATS: Stats = {
  kind: "requests",
  ...NO_FIGURES,
  roundTrip: null,
  server: null,
  serverBound: false,
  throughput: null,
  frame: null,
  video: null,
  transport: null,
  enhanceMs: null,
  inFlight: 0,
  counts: { sent: 0, cancelled: 0, dropped: 0 },
};

/** Window of the HUD's figures, in milliseconds. */
const SPAN = 5000;
const PARTS = ["queue", "render", "encode"] as const;
/** The server is the limit if frames spend longer than this in it (ms), and a larger share of the response time. */
const BOUND_AFTER = 50;
const BOUND_SHARE = 0.6;

export class StatsRecorder {
  readonly throughput = new ThroughputEstimator();
  readonly #roundTrip = new TimeWindow(SPAN);
  readonly #server = { queue: new TimeWindow(SPAN), render: new TimeWindow(SPAN), encode: new TimeWindow(SPAN) };
  /** Times of frames of a moving camera; refined frames, which have no rung and take longer, are left out. */
  readonly #moving = { response: new TimeWindow(SPAN), server: new TimeWindow(SPAN) };
  #last: FrameReply | undefined;

  replied(reply: FrameReply, now: number): void {
    this.throughput.observe(reply.arrival);
    const response = reply.arrival.lastByteAt - reply.arrival.sentAt;
    this.#roundTrip.add(response, now);
    const { timing, profile } = reply.header;
    for (const part of PARTS) if (timing != null) this.#server[part].add(timing[part], now);
    if (timing != null && profile != null) {
      this.#moving.response.add(response, now);
      this.#moving.server.add(timing.queue + timing.render + timing.encode, now);
    }
    this.#last = reply;
  }

  snapshot(now: number): ReplyStats {
    const header = this.#last?.header;
    return {
      roundTrip: lately(this.#roundTrip, now),
      server: this.#serverTimes(now),
      serverBound: this.#serverBound(now),
      throughput: this.throughput.bitsPerSecond,
      frame:
        (this.#last && {
          bytes: this.#last.image.size,
          width: header?.width ?? null,
          height: header?.height ?? null,
          profile: header?.profile ?? null,
          ...(header?.content_type === "image/webp" && { webp: true }),
        }) ||
        null,
    };
  }

  #serverTimes(now: number): ServerTiming | null {
    const [queue, render, encode] = PARTS.map((part) => lately(this.#server[part], now));
    return queue == null || render == null || encode == null ? null : { queue, render, encode };
  }

  #serverBound(now: number): boolean {
    const server = this.#moving.server.percentile(0.5, now) ?? 0;
    return server > BOUND_AFTER && server > BOUND_SHARE * (this.#moving.response.percentile(0.5, now) ?? 0);
  }
}

/** The median over the last seconds with frames, so that it stays readable when nothing moves. */
function lately(window: TimeWindow, now: number): number | null {
  return window.percentile(0.5, window.latest ?? now);
}
