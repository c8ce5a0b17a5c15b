/**
 * The last minute of the pictures on the stage, in the columns of the charts. Observes frames as they are presented.
 */
import { type Signal, signal } from "@preact/signals";
import type { Figures } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import { TimeWindow } from "../view/window";

/*
 * Distribution of latencies, in bins of equal width on a logarithmic axis, so that 40 ms and 2 s fit into one chart.
 */

/** The axis, in milliseconds. */
export const LATENCY_RANGE_MS = [10, 5000] as const;
const BINS_PER_DECADE = 12;
const COUNT = Math.ceil(Math.log10(LATENCY_RANGE_MS[1] / LATENCY_RANGE_MS[0]) * BINS_PER_DECADE);

/** Where each bin begins, in milliseconds. */
export const LATENCY_BINS_MS: readonly number[] = Array.from(
  { length: COUNT },
  (_, i) => LATENCY_RANGE_MS[0] * 10 ** (i / BINS_PER_DECADE),
);

/** Percent of the values in each bin; values outside the axis count in the outermost bins. All null without values. */
export function histogram(values: readonly number[]): readonly (number | null)[] {
  if (values.length === 0) return LATENCY_BINS_MS.map(() => null);
  const counts = LATENCY_BINS_MS.map(() => 0);
  for (const value of values) {
    const bin = Math.floor(
      Math.log10(Math.max(value, LATENCY_RANGE_MS[0]) / LATENCY_RANGE_MS[0]) * BINS_PER_DECADE + 1e-9,
    );
    const place = Math.min(COUNT - 1, bin);
    counts[place] = (counts[place] ?? 0) + 1;
  }
  return counts.map((count) => (100 * count) / values.length);
}

/** Seconds. */
export const SPAN_S = 60;
/** No line is drawn across a longer time without samples, in seconds. */
const GAP = 2;

export type Column = readonly (number | null)[];
/** Times in seconds, rising; and the values of each quantity at them. */
export type Columns = readonly [times: readonly number[], ...values: Column[]];

export function noColumns(quantities: number): Columns {
  return [[], ...Array.from({ length: quantities }, () => [])];
}

/** The columns with an additional sample, without those older than the span. */
export function append(columns: Columns, time: number, values: Column): Columns {
  const [times, ...series] = columns;
  const last = times.at(-1);
  const broken = last !== undefined && time - last > GAP;
  const kept = times.findIndex((at) => at >= time - SPAN_S);
  const from = kept < 0 ? times.length : kept;
  return [
    [...times.slice(from), ...(broken ? [time - GAP / 2] : []), time],
    ...series.map((column, i) => [...column.slice(from), ...(broken ? [null] : []), values[i] ?? null]),
  ];
}

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
