/**
 * Measures every mode in the same way: frame rate, latency and cost. Where the page warps frames to newer poses,
 * latency is that of the view, and the age of the content is that of the pose of its pixels.
 */
import { MotionToPhoton } from "./motion-to-photon";
import type { PresentedFrame, Side } from "./presented";
import { StallDetector, type Stalls } from "./stalls";
import { nearestRank, TimeWindow } from "./window";

/** Poses older than this are forgotten, in milliseconds: their pictures are no longer on the screen. */
const SPAN = 10_000;

export class PoseTimes {
  #times: { readonly pose: number; at: number }[] = [];

  /** Records that the camera is at pose number `pose` at a time. */
  sampled(pose: number, at: number): void {
    const last = this.#times.at(-1);
    if (last?.pose === pose) last.at = at;
    else this.#times.push({ pose, at });
    while (this.#times.length > 1 && (this.#times[0]?.at ?? at) < at - SPAN) this.#times.shift();
  }

  /** Excludes the last `gap` milliseconds, in which the page was hidden. */
  resumed(gap: number): void {
    for (const time of this.#times) time.at += gap;
  }

  /** For how long the camera has been away from this pose, in milliseconds; null if unknown. */
  age(pose: number, now: number): number | null {
    const time = this.#times.findLast((one) => one.pose <= pose);
    return time === undefined ? null : now - time.at;
  }
}

export interface Figures {
  /** New views shown per second; repeated frames do not count. */
  readonly newViewsPerSecond: number;
  /**
   * Median and 95th percentile over the last seconds of movement in milliseconds, including inputs that have waited
   * unusually long and are not on screen; null before any movement.
   */
  readonly motionToPhoton: { readonly p50: number; readonly p95: number } | null;
  /** Whether pictures are turned to the newest view; the latency is then the view's. */
  readonly turned: boolean;
  /**
   * Time from the pose of the pixels until they are on screen: the median over the last seconds of movement, or the
   * current value if larger, in milliseconds; null before the first frame.
   */
  readonly contentAge: number | null;
  /** Time without a new view although the camera has moved, in milliseconds; 0 otherwise. */
  readonly frozenFor: number;
  /** Bits per second received during the last seconds. */
  readonly bandwidth: number;
  /** Total bytes received. */
  readonly bytes: number;
  /** Buffered milliseconds of the stream; null where pictures are shown on arrival. */
  readonly buffered: number | null;
  readonly stalls: Stalls;
  readonly newViews: number;
  /** All frames shown so far. */
  readonly shown: number;
  /** The main thread's time to turn a picture in milliseconds, median of the last seconds; null while none is turned. */
  readonly warpMs: number | null;
  /** GPU time in milliseconds; null where it is not measured. */
  readonly gpuMs: number | null;
  /** Whether no better picture of the current view will follow. */
  readonly settled: boolean;
  readonly picture: { readonly rung: number | null; readonly width: number; readonly height: number } | null;
}

export const NO_FIGURES: Figures = {
  newViewsPerSecond: 0,
  motionToPhoton: null,
  turned: false,
  contentAge: null,
  frozenFor: 0,
  bandwidth: 0,
  bytes: 0,
  buffered: null,
  stalls: { count: 0, time: 0 },
  newViews: 0,
  shown: 0,
  warpMs: null,
  gpuMs: null,
  settled: true,
  picture: null,
};

/** Update interval of the HUD: short enough to be live, long enough to be readable (ms). */
export const STATS_EVERY = 250;

/** Windows of the figures, in milliseconds. */
const RATE_SPAN = 1000;
const BANDWIDTH_SPAN = 2000;
const LATENCY_SPAN = 5000;
/**
 * With the camera moving, a picture unchanged for longer than this is frozen, in milliseconds; reported within a
 * second.
 */
export const FROZEN_AFTER = 700;

export class Meter {
  readonly #side: Side;
  readonly #latency = new MotionToPhoton();
  readonly #stalls = new StallDetector();
  readonly #views = new TimeWindow(RATE_SPAN);
  readonly #bytes = new TimeWindow(BANDWIDTH_SPAN);
  readonly #motionToPhoton = new TimeWindow(LATENCY_SPAN);
  readonly #poses = new PoseTimes();
  readonly #ages = new TimeWindow(LATENCY_SPAN);
  readonly #listener: (frame: PresentedFrame) => void;
  #received = 0;
  #newViews = 0;
  #shown = 0;
  #last: PresentedFrame | undefined;
  /** Time since when a new view is expected; undefined while none is. */
  #viewAt: number | undefined;

  constructor(side: Side, listener: (frame: PresentedFrame) => void) {
    this.#side = side;
    this.#listener = listener;
  }

  /** Called once per animation frame: the camera is at pose number `pose`. */
  sampled(pose: number, at: number): void {
    this.#poses.sampled(pose, at);
  }

  /** Records that the camera moved, which made pose number `pose`. */
  moved(pose: number, at: number): void {
    this.#latency.sampled(pose, at);
    this.#stalls.moved(at);
  }

  received(bytes: number, at: number): void {
    this.#bytes.add(bytes, at);
    this.#received += bytes;
  }

  /** Records a frame on screen; unless `fresh`, it is the previous frame warped to another view. */
  presented(frame: Omit<PresentedFrame, "side" | "latencies">, fresh = true): void {
    const latencies = this.#latency.presented(frame.view ?? frame.pose, frame.at);
    for (const latency of latencies) this.#motionToPhoton.add(latency, frame.at);
    const age = this.#poses.age(frame.pose, frame.at);
    if (age !== null) this.#ages.add(age, frame.at);
    // A stream repeats its last frame when no new view is ready in time; the picture is then as frozen as without
    // frames.
    if (frame.pose !== this.#last?.pose) {
      this.#stalls.presented(frame.at);
      this.#views.add(1, frame.at);
      this.#viewAt = frame.at;
      this.#newViews++;
    }
    if (fresh) this.#shown++;
    this.#last = { ...frame, side: this.#side, latencies };
    this.#listener(this.#last);
  }

  /** Drops poses without a frame for reasons other than latency (a lost server, another mode). */
  reset(): void {
    this.#latency.reset();
    this.#viewAt = undefined;
  }

  /** Excludes the last `gap` milliseconds, in which the page was hidden. Call first in the animation frame. */
  resumed(gap: number): void {
    this.#latency.reset();
    this.#poses.resumed(gap);
    if (this.#viewAt !== undefined) this.#viewAt += gap;
  }

  figures(now: number): Figures {
    const bytes = this.#bytes.values(now).reduce((sum, value) => sum + value, 0);
    return {
      newViewsPerSecond: this.#views.rate(now),
      motionToPhoton: this.#latencyFigures(now),
      turned: this.#last?.view !== undefined,
      contentAge: this.#contentAge(now),
      frozenFor: this.#frozenFor(now),
      bandwidth: (bytes * 8000) / BANDWIDTH_SPAN,
      bytes: this.#received,
      buffered: null,
      stalls: this.#stalls.stalls(now),
      newViews: this.#newViews,
      shown: this.#shown,
      warpMs: null,
      gpuMs: null,
      settled: true,
      picture: this.#last ?? null,
    };
  }

  #latencyFigures(now: number): Figures["motionToPhoton"] {
    const shown = this.#motionToPhoton;
    const latest = shown.latest ?? now; // figures are kept while the camera rests
    const usual = shown.percentile(0.5, latest) ?? 0;
    const late = this.#latency.waiting(now).filter((age) => age > usual);
    const all = [...shown.values(late.length > 0 ? now : latest), ...late];
    const p50 = nearestRank(all, 0.5);
    const p95 = nearestRank(all, 0.95);
    return p50 === null || p95 === null ? null : { p50, p95 };
  }

  #contentAge(now: number): number | null {
    const usual = this.#ages.percentile(0.5, this.#ages.latest ?? now);
    return usual === null ? null : Math.max(usual, this.#elsewhereFor(now));
  }

  #frozenFor(now: number): number {
    return this.#viewAt === undefined ? 0 : Math.min(this.#elsewhereFor(now), now - this.#viewAt);
  }

  /** Time since the camera left the view on screen. */
  #elsewhereFor(now: number): number {
    if (this.#last === undefined || this.#viewAt === undefined) return 0;
    return this.#poses.age(this.#last.pose, now) ?? now - this.#viewAt; // longer than poses are remembered
  }
}
