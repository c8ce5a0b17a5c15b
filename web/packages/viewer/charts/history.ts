/**
 * The last minute of the pictures on the stage, in the columns of the charts. Observes frames as they are presented.
 */
import { type Signal, signal } from "@preact/signals";
import type { Figures } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import { TimeWindow } from "../view/window";
import { append, type Columns, noColumns, SPAN_S } from "./columns";
import { histogram, LATENCY_BINS_MS } from "./histogram";

/** Present figures of each picture's meter, from left to right; null without a picture. */
export type SideFigures = readonly (Figures | null)[];

const MBIT = 1e6;

export class ComparisonHistory {
  /** Percent of the last minute's inputs over latency (not over time). */
  readonly latency: Signal<Columns>;
  /** Mbit/s. */
  readonly bandwidth: Signal<Columns>;
  /** Seconds stalled since the side began. */
  readonly stalled: Signal<Columns>;
  /** New views a second. */
  readonly newViews: Signal<Columns>;
  /** Lines of pixels in the picture. */
  readonly lines: Signal<Columns>;
  /** Milliseconds of a stream that wait to be shown. */
  readonly buffered: Signal<Columns>;
  readonly #latencies: readonly TimeWindow[];

  constructor(sides: number) {
    this.#latencies = Array.from({ length: sides }, () => new TimeWindow(SPAN_S * 1000));
    this.latency = signal<Columns>([LATENCY_BINS_MS, ...this.#latencies.map(() => histogram([]))]);
    const columns = () => signal(noColumns(sides));
    [this.bandwidth, this.stalled, this.newViews] = [columns(), columns(), columns()];
    [this.lines, this.buffered] = [columns(), columns()];
  }

  /** A frame of picture number `side` is on the screen. */
  presented(side: number, { at, latencies }: Pick<PresentedFrame, "at" | "latencies">): void {
    for (const latency of latencies) this.#latencies[side]?.add(latency, at);
  }

  /** Take a sample of all; `now` in milliseconds. */
  sample(figures: SideFigures, now: number): void {
    const each = (value: (of: Figures) => number | null) => figures.map((of) => of && value(of));
    const add = (columns: Columns, values: (number | null)[]) => append(columns, now / 1000, values);
    this.latency.value = [LATENCY_BINS_MS, ...this.#latencies.map((window) => histogram(window.values(now)))];
    this.bandwidth.value = add(
      this.bandwidth.peek(),
      each(({ bandwidth }) => bandwidth / MBIT),
    );
    this.stalled.value = add(
      this.stalled.peek(),
      each(({ stalls }) => stalls.time / 1000),
    );
    this.newViews.value = add(
      this.newViews.peek(),
      each(({ newViewsPerSecond }) => newViewsPerSecond),
    );
    this.lines.value = add(
      this.lines.peek(),
      each(({ picture }) => picture?.height ?? null),
    );
    this.buffered.value = add(
      this.buffered.peek(),
      each(({ buffered }) => buffered),
    );
  }
}
