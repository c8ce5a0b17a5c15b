/**
 * Measures one side, stateless or DASH, in the same way: what is shown, how late, and what it costs. Where the page turns frames to
 * newer poses, latency is the view's, and the age of the content says how old the pose of its pixels is.
 */
import { MotionToPhoton } from "./motion-to-photon";
import { PoseTimes } from "./pose-times";
import type { PresentedFrame, Side } from "./presented";
import { StallDetector, type Stalls } from "./stalls";
import { nearestRank, TimeWindow } from "./window";

export interface Figures {
  /** Views shown a second that were not there before: a repeated frame is none. */
  readonly newViewsPerSecond: number;
  /**
   * Median and 95th percentile of the last seconds of movement, in milliseconds, with inputs that have waited for longer than is usual
   * and are not shown yet; null before anything moved.
   */
  readonly motionToPhoton: { readonly p50: number; readonly p95: number } | null;
  /** Pictures are turned to the newest view: the latency is the view's. */
  readonly turned: boolean;
  /**
   * From the pose of the pixels until they are seen: median of the last seconds of movement, or what it is at present if that is more,
   * in milliseconds; null before anything was shown.
   */
  readonly contentAge: number | null;
  /** For how long no new view has come although the camera is elsewhere, in milliseconds; 0 if it is not. */
  readonly frozenFor: number;
  /** Bits a second that came in during the last seconds. */
  readonly bandwidth: number;
  /** All bytes that came in so far. */
  readonly bytes: number;
  /** What has come and waits for its turn, in milliseconds of the stream; null where pictures are shown as soon as they come. */
  readonly buffered: number | null;
  readonly stalls: Stalls;
  /** All new views shown so far. */
  readonly newViews: number;
  /** All frames shown so far. */
  readonly shown: number;
  /** The frame on the screen. */
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
  picture: null,
};

/** How often the HUD changes: often enough to be live, seldom enough to be read (ms). */
export const STATS_EVERY = 250;

/** How far back the figures look, in milliseconds. */
const RATE_SPAN = 1000;
const BANDWIDTH_SPAN = 2000;
const LATENCY_SPAN = 5000;
/** A picture that stands still for longer while the camera moved is frozen, in milliseconds: that is said within a second. */
export const FROZEN_AFTER = 700;
/** A page that takes no sample for so long is not looked at, in milliseconds. */
const HIDDEN_AFTER = 500;

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
  /** Since when a new view may be expected; undefined while none is. */
  #viewAt: number | undefined;
  #sampledAt = 0;

  constructor(side: Side, listener: (frame: PresentedFrame) => void) {
    this.#side = side;
    this.#listener = listener;
  }

  /** Once per animation frame: the camera is at pose number `pose`. */
  sampled(pose: number, at: number): void {
    this.#poses.sampled(pose, at);
    if (this.#viewAt !== undefined && at - this.#sampledAt > HIDDEN_AFTER) this.#viewAt = at;
    this.#sampledAt = at;
  }

  /** The camera moved, which made pose number `pose`. */
  moved(pose: number, at: number): void {
    this.#latency.sampled(pose, at);
    this.#stalls.moved(at);
  }

  /** Bytes of pictures came in. */
  received(bytes: number, at: number): void {
    this.#bytes.add(bytes, at);
    this.#received += bytes;
  }

  /** A frame is on the screen, or, unless `fresh`, one that was there is turned to another view. */
  presented(frame: Omit<PresentedFrame, "side" | "latencies">, fresh = true): void {
    const latencies = this.#latency.presented(frame.view ?? frame.pose, frame.at);
    for (const latency of latencies) this.#motionToPhoton.add(latency, frame.at);
    const age = this.#poses.age(frame.pose, frame.at);
    if (age !== null) this.#ages.add(age, frame.at);
    // A stream repeats its last frame when no new view came in time: the picture stands still then as it does without frames.
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

  /** Forget poses whose frames will not come, for a reason that is not latency (a lost server, another mode). */
  reset(): void {
    this.#latency.reset();
    this.#viewAt = undefined;
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
      stalls: this.#stalls.stalls,
      newViews: this.#newViews,
      shown: this.#shown,
      picture: this.#last ?? null,
    };
  }

  #latencyFigures(now: number): Figures["motionToPhoton"] {
    const shown = this.#motionToPhoton;
    const latest = shown.latest ?? now; // while the camera rests, figures stay as they were
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

  /** For how long the camera has been elsewhere than what is on the screen. */
  #elsewhereFor(now: number): number {
    if (this.#last === undefined || this.#viewAt === undefined) return 0;
    return this.#poses.age(this.#last.pose, now) ?? now - this.#viewAt; // longer than poses are remembered
  }

  /** Motion-to-photon latencies of the last seconds, in milliseconds. */
  latencies(now: number): readonly number[] {
    return this.#motionToPhoton.values(now);
  }
}
