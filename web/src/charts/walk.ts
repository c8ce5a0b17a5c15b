/** The last walk, and what each side made of it: from the camera's first movement until it has stood still for a while. */
import { signal } from "@preact/signals";
import type { PresentedFrame } from "../view/presented";
import { type ComparedSide, comparedSide, SIDES, type SideFigures } from "./history";

/** Whoever has not moved for so long has ended the walk: frames on their way have come by then (ms). */
const STILL_AFTER = 2000;
/** Shorter ones say little (ms). */
const SHORTEST = 3000;

export interface WalkedSide {
  /** Motion to photon, or the view's latency where pictures are turned: median and 95th percentile, in milliseconds. */
  readonly latency: { readonly p50: number; readonly p95: number };
  readonly newViewsPerSecond: number;
  /** Bits a second. */
  readonly bandwidth: number;
  /** How long the picture stood still, in milliseconds. */
  readonly stalled: number;
}

export interface Walk {
  /** How long the camera moved, in milliseconds. */
  readonly duration: number;
  /** Null for a side that showed nothing, or began anew meanwhile. */
  readonly sides: Readonly<Record<ComparedSide, WalkedSide | null>>;
}

/** What has come from the walk that goes on. */
interface Going {
  readonly from: number;
  readonly before: SideFigures;
  readonly latencies: Readonly<Record<ComparedSide, number[]>>;
  movedAt: number;
  /** When the camera moved last: a stream goes on sending while it stands still. */
  moved: SideFigures;
}

export class WalkRecorder {
  /** Stays until the next one has ended; null before the first. */
  readonly last = signal<Walk | null>(null);
  #pose: number | null = null;
  #movedAt = Number.NEGATIVE_INFINITY;
  #going: Going | null = null;

  /** The camera is at pose number `pose`; `at` in milliseconds. */
  sampled(pose: number, at: number): void {
    if (this.#pose !== null && pose !== this.#pose) this.#movedAt = at;
    this.#pose = pose;
  }

  presented({ side, latencies }: Pick<PresentedFrame, "side" | "latencies">): void {
    const compared = comparedSide(side);
    if (compared) this.#going?.latencies[compared].push(...latencies);
  }

  /** Take a sample of both sides, several times a second; `now` in milliseconds. */
  sample(figures: SideFigures, now: number): void {
    const going = this.#going;
    if (going === null) {
      if (now - this.#movedAt < STILL_AFTER) this.#going = begun(figures, this.#movedAt);
    } else if (this.#movedAt > going.movedAt) {
      going.movedAt = this.#movedAt;
      going.moved = figures;
    } else if (now - going.movedAt >= STILL_AFTER) {
      this.#going = null;
      if (going.movedAt - going.from >= SHORTEST) this.last.value = ended(going, figures);
    }
  }
}

function begun(figures: SideFigures, movedAt: number): Going {
  return { from: movedAt, movedAt, before: figures, moved: figures, latencies: { stateless: [], dash: [] } };
}

/** `after`: once all that was on its way has been shown. */
function ended({ from, movedAt, before, moved, latencies }: Going, after: SideFigures): Walk {
  const duration = movedAt - from;
  const side = (of: ComparedSide): WalkedSide | null => {
    const sorted = latencies[of].toSorted((a, b) => a - b);
    const percentile = (rank: number) => sorted[Math.ceil(rank * sorted.length) - 1] ?? 0;
    const [first, last, shown] = [before[of], moved[of], after[of]];
    if (!first || !last || !shown || shown.shown < first.shown || sorted.length === 0) return null;
    return {
      latency: { p50: percentile(0.5), p95: percentile(0.95) },
      newViewsPerSecond: ((shown.newViews - first.newViews) * 1000) / duration,
      bandwidth: ((last.bytes - first.bytes) * 8000) / duration,
      stalled: shown.stalls.time - first.stalls.time,
    };
  };
  return { duration, sides: { stateless: side(SIDES[0]), dash: side(SIDES[1]) } };
}
