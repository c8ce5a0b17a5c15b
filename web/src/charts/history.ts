/** The last minute of both sides, in the columns that the charts draw. It hears frames as they are presented. */
import { signal } from "@preact/signals";
import type { Figures } from "../view/meter";
import type { PresentedFrame, Side } from "../view/presented";
import { TimeWindow } from "../view/window";
import { append, type Columns, noColumns, SPAN_S } from "./columns";
import { histogram, LATENCY_BINS_MS } from "./histogram";

/** Both sides, in the order of the columns. */
export const SIDES = ["stateless", "dash"] as const satisfies readonly Side[];

/** The sides that are compared. */
export type ComparedSide = (typeof SIDES)[number];

/** The same side, if it is compared. */
export const comparedSide = (side: Side): ComparedSide | undefined => SIDES.find((one) => one === side);

/** What a side's meter says at present; null for a side that is not shown. */
export type SideFigures = Readonly<Record<ComparedSide, Figures | null>>;

const MBIT = 1e6;

export class ComparisonHistory {
  /** Percent of the last minute's inputs over latency (not over time). */
  readonly latency = signal<Columns>([LATENCY_BINS_MS, ...SIDES.map(() => histogram([]))]);
  /** Mbit/s. */
  readonly bandwidth = signal(noColumns(SIDES.length));
  /** Seconds stalled since the side began. */
  readonly stalled = signal(noColumns(SIDES.length));
  /** New views a second. */
  readonly newViews = signal(noColumns(SIDES.length));
  /** Lines of pixels in the picture. */
  readonly lines = signal(noColumns(SIDES.length));
  readonly #latencies: Readonly<Record<ComparedSide, TimeWindow>> = {
    stateless: new TimeWindow(SPAN_S * 1000),
    dash: new TimeWindow(SPAN_S * 1000),
  };

  presented({ side, at, latencies }: Pick<PresentedFrame, "side" | "at" | "latencies">): void {
    const compared = comparedSide(side);
    if (compared) for (const latency of latencies) this.#latencies[compared].add(latency, at);
  }

  /** Take a sample of both sides; `now` in milliseconds. */
  sample(figures: SideFigures, now: number): void {
    const both = (value: (of: Figures) => number | null) =>
      SIDES.map((side) => {
        const of = figures[side];
        return of && value(of);
      });
    const add = (columns: Columns, values: (number | null)[]) => append(columns, now / 1000, values);
    this.latency.value = [LATENCY_BINS_MS, ...SIDES.map((side) => histogram(this.#latencies[side].values(now)))];
    this.bandwidth.value = add(
      this.bandwidth.peek(),
      both(({ bandwidth }) => bandwidth / MBIT),
    );
    this.stalled.value = add(
      this.stalled.peek(),
      both(({ stalls }) => stalls.time / 1000),
    );
    this.newViews.value = add(
      this.newViews.peek(),
      both(({ newViewsPerSecond }) => newViewsPerSecond),
    );
    this.lines.value = add(
      this.lines.peek(),
      both(({ picture }) => picture?.height ?? null),
    );
  }
}
