/**
 * The last walk and each side's figures for it: from the camera's first movement until it has stood still for some
 * time.
 */
import { signal } from "@preact/signals";
import type { PresentedFrame } from "../view/presented";
import { nearestRank } from "../view/window";
import type { SideFigures } from "./history";

/** Standing still for this long ends a walk; frames in flight have arrived by then (ms). */
const STILL_AFTER = 2000;
/** Shorter walks are ignored (ms). */
const SHORTEST = 3000;

export interface WalkedSide {
  /** Number of pose changes that it answered. */
  readonly inputs: number;
  /** Age of the pixels on the screen: median while the camera moved, in milliseconds. */
  readonly contentAge: number;
  /** Motion to photon, or the view's latency where pictures are turned: median and 95th percentile, in milliseconds. */
  readonly latency: { readonly p50: number; readonly p95: number };
  /** 0 if it only showed turned versions of an earlier picture. */
  readonly newViewsPerSecond: number;
  /** Bits per second. */
  readonly bandwidth: number;
  readonly bytes: number;
  /** How long the picture stood still, in milliseconds. */
  readonly stalled: number;
}

/**
 * The side showed nothing of the walk, or was restarted during it (another stream), so its counts do not cover the
 * walk.
 */
export type Unmeasured = "nothing" | "restarted";

export interface Walk {
  /** How long the camera moved, in milliseconds. */
  readonly duration: number;
  /** From left to right. */
  readonly sides: readonly (WalkedSide | Unmeasured)[];
}

interface Going {
  readonly from: number;
  readonly before: SideFigures;
  readonly latencies: readonly number[][];
  readonly contentAges: readonly number[][];
  /** Sides that restarted, by number. */
  readonly restarted: Set<number>;
  latest: SideFigures;
  movedAt: number;
  /** Time of the last movement: a stream continues to send frames afterwards. */
  moved: SideFigures;
}

export class WalkRecorder {
  /** The last walk, kept until the next one ends; null before the first. */
  readonly last = signal<Walk | null>(null);
  #pose: number | null = null;
  #movedAt = Number.NEGATIVE_INFINITY;
  #going: Going | null = null;

  get walking(): boolean {
    return this.#going !== null;
  }

  /** When the camera moved last, in milliseconds. */
  get movedAt(): number {
    return this.#movedAt;
  }

  /** Records that the camera is at pose number `pose`; `at` in milliseconds. */
  sampled(pose: number, at: number): void {
    if (this.#pose !== null && pose !== this.#pose) this.#movedAt = at;
    this.#pose = pose;
  }

  /** Drops a walk that was interrupted because the page was hidden. */
  resumed(): void {
    this.#going = null;
    this.#movedAt = Number.NEGATIVE_INFINITY;
  }

  /** Records a frame of picture number `side` on the screen. */
  presented(side: number, { latencies }: Pick<PresentedFrame, "latencies">): void {
    this.#going?.latencies[side]?.push(...latencies);
  }

  /** Samples all sides, several times a second; `now` in milliseconds. */
  sample(figures: SideFigures, now: number): void {
    const going = this.#going;
    if (going === null) {
      if (now - this.#movedAt < STILL_AFTER) this.#going = begun(figures, this.#movedAt);
      return;
    }
    const { latest, restarted } = going;
    going.latest = figures;
    for (const side of figures.keys()) if (pictures(figures, side) < pictures(latest, side)) restarted.add(side);
    const arrives = (side: number) =>
      pictures(latest, side) === 0 && pictures(figures, side) > 0 && !restarted.has(side);
    const moving = this.#movedAt > going.movedAt;
    if (moving && [...figures.keys()].some(arrives)) {
      this.#going = null; // the comparable part of the walk starts here
    } else if (moving) {
      going.movedAt = this.#movedAt;
      going.moved = figures;
      for (const [side, of] of figures.entries())
        if (of?.contentAge != null) going.contentAges[side]?.push(of.contentAge);
    } else if (now - going.movedAt >= STILL_AFTER) {
      this.#going = null;
      if (going.movedAt - going.from >= SHORTEST) this.last.value = ended(going, figures);
    }
  }
}

function begun(figures: SideFigures, movedAt: number): Going {
  const perSide = { latencies: figures.map(() => []), contentAges: figures.map(() => []) };
  return { from: movedAt, movedAt, before: figures, moved: figures, latest: figures, ...perSide, restarted: new Set() };
}

/** Number of pictures that a side has shown so far. */
function pictures(figures: SideFigures, side: number): number {
  return figures[side]?.shown ?? 0;
}

/** Figures of a walk; `after` is sampled once everything in flight has been shown. */
function ended({ from, movedAt, before, moved, latencies, contentAges, restarted }: Going, after: SideFigures): Walk {
  const duration = movedAt - from;
  const sides = latencies.map((times, side): WalkedSide | Unmeasured => {
    if (restarted.has(side)) return "restarted";
    const contentAge = nearestRank(contentAges[side] ?? [], 0.5);
    const [p50, p95] = [nearestRank(times, 0.5), nearestRank(times, 0.95)];
    const [first, last, shown] = [before[side], moved[side], after[side]];
    if (!first || !last || !shown || p50 === null || p95 === null || contentAge === null) return "nothing";
    return {
      inputs: times.length,
      contentAge,
      latency: { p50, p95 },
      newViewsPerSecond: ((shown.newViews - first.newViews) * 1000) / duration,
      bandwidth: ((last.bytes - first.bytes) * 8000) / duration,
      bytes: last.bytes - first.bytes,
      stalled: shown.stalls.time - first.stalls.time,
    };
  });
  return { duration, sides };
}
