/** What the HUD shows, gathered from frames as they come and are presented. */
import { ThroughputEstimator } from "../abr/throughput";
import type { FrameReply, TransportKind } from "../transport/transport";
import type { ServerTiming } from "../wire";
import type { PipelineCounts } from "./pipeline";
import { TimeWindow } from "./window";

export interface Stats {
  /** Frames shown a second. */
  readonly framesPerSecond: number;
  /** Median and 95th percentile of the last seconds, in milliseconds; null while nothing moved. */
  readonly motionToPhoton: { readonly p50: number; readonly p95: number } | null;
  /** From sending a request to its frame's last byte, median of the last seconds, in milliseconds. */
  readonly roundTrip: number | null;
  /** Where the server's time went for the last frame, in milliseconds. */
  readonly server: ServerTiming | null;
  /** Bits per second. */
  readonly throughput: number | null;
  readonly frame: {
    readonly bytes: number;
    readonly width: number | null;
    readonly height: number | null;
    readonly profile: number | null;
  } | null;
  readonly transport: TransportKind | null;
  readonly inFlight: number;
  readonly counts: PipelineCounts;
  /** All frames shown so far. */
  readonly shown: number;
  /** The newest view is on the screen. */
  readonly settled: boolean;
}

const NO_COUNTS: PipelineCounts = { sent: 0, cancelled: 0, dropped: 0 };

export const NO_STATS: Stats = {
  framesPerSecond: 0,
  motionToPhoton: null,
  roundTrip: null,
  server: null,
  throughput: null,
  frame: null,
  transport: null,
  inFlight: 0,
  counts: NO_COUNTS,
  shown: 0,
  settled: true,
};

/** How far back the HUD looks, in milliseconds. */
const RATE_SPAN = 1000;
const LATENCY_SPAN = 5000;

export class StatsRecorder {
  readonly throughput = new ThroughputEstimator();
  readonly #frames = new TimeWindow(RATE_SPAN);
  readonly #motionToPhoton = new TimeWindow(LATENCY_SPAN);
  readonly #roundTrip = new TimeWindow(LATENCY_SPAN);
  #last: FrameReply | undefined;
  #shown = 0;

  replied(reply: FrameReply, now: number): void {
    this.throughput.observe(reply.arrival);
    this.#roundTrip.add(reply.arrival.lastByteAt - reply.arrival.sentAt, now);
    this.#last = reply;
  }

  /** A frame is on the screen, with the motion-to-photon latency of each input that it shows first. */
  presented(latencies: readonly number[], now: number): void {
    this.#shown++;
    this.#frames.add(1, now);
    for (const latency of latencies) this.#motionToPhoton.add(latency, now);
  }

  snapshot(
    now: number,
    current: Pick<Stats, "transport" | "inFlight" | "settled"> & { readonly counts?: PipelineCounts },
  ): Stats {
    const p50 = this.#motionToPhoton.percentile(0.5, now);
    const p95 = this.#motionToPhoton.percentile(0.95, now);
    const header = this.#last?.header;
    return {
      ...current,
      counts: current.counts ?? NO_COUNTS,
      framesPerSecond: this.#frames.rate(now),
      motionToPhoton: p50 === null || p95 === null ? null : { p50, p95 },
      roundTrip: this.#roundTrip.percentile(0.5, now),
      server: header?.timing ?? null,
      throughput: this.throughput.bitsPerSecond,
      frame:
        (this.#last && {
          bytes: this.#last.image.size,
          width: header?.width ?? null,
          height: header?.height ?? null,
          profile: header?.profile ?? null,
        }) ||
        null,
      shown: this.#shown,
    };
  }
}
