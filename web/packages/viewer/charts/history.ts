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

/** Range of the axis, in milliseconds. */
export const LATENCY_RANGE_MS = [10, 5000] as const;
const BINS_PER_DECADE = 12;
const COUNT = Math.ceil(Math.log10(LATENCY_RANGE_MS[1] / LATENCY_RANGE_MS[0]) * BINS_PER_DECADE);

/** Lower bounds of the bins, in milliseconds. */
export const LATENCY_BINS_MS: readonly number[] = Array.from(
  { length: COUNT },
  (_, i) => LATENCY_RANGE_MS[0] * 10 ** (i / BINS_PER_DECADE),
);

/** Percent of the values in each bin; values outside the axis count in the outermost bins. All null without values. */
function histogram(values: readonly number[]): readonly (number | null)[] {
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

/** Length of the charts, in seconds. */
export const SPAN_S = 60;
/** No line is drawn across a longer time without samples, in seconds. */
const GAP = 2;

export type Column = readonly (number | null)[];
/** Ascending times in seconds, and the values of each quantity at these times. */
export type Columns = readonly [times: readonly number[], ...values: Column[]];

export function noColumns(quantities: number): Columns {
  return [[], ...Array.from({ length: quantities }, () => [])];
}

/** The columns with an additional sample, without samples older than the span. */
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

/** Figures that are sampled over time. */
const SAMPLED = {
  /** Mbit/s. */
  bandwidth: ({ bandwidth }: Figures) => bandwidth / 1e6,
  /** Seconds stalled since the side started. */
  stalled: ({ stalls }: Figures) => stalls.time / 1000,
  /** New views per second. */
  newViews: ({ newViewsPerSecond }: Figures) => newViewsPerSecond,
  /** Lines of pixels in the picture. */
  lines: ({ picture }: Figures) => picture?.height ?? null,
  /** Buffered milliseconds of a stream. */
  buffered: ({ buffered }: Figures) => buffered,
} satisfies Readonly<Record<string, (of: Figures) => number | null>>;

type Sampled = keyof typeof SAMPLED;
const NAMES = Object.keys(SAMPLED) as Sampled[];

export class ComparisonHistory {
  /** Percent of the last minute's inputs over latency (not over time). */
  readonly latency: Signal<Columns>;
  readonly series: Readonly<Record<Sampled, Signal<Columns>>>;
  readonly #latencies: readonly TimeWindow[];

  constructor(sides: number) {
    this.#latencies = Array.from({ length: sides }, () => new TimeWindow(SPAN_S * 1000));
    this.latency = signal<Columns>([LATENCY_BINS_MS, ...this.#latencies.map(() => histogram([]))]);
    const series = NAMES.map((name) => [name, signal(noColumns(sides))]);
    this.series = Object.fromEntries(series) as ComparisonHistory["series"];
  }

  /** Records a frame of picture number `side` on the screen. */
  presented(side: number, { at, latencies }: Pick<PresentedFrame, "at" | "latencies">): void {
    for (const latency of latencies) this.#latencies[side]?.add(latency, at);
  }

  /** Samples all pictures; `now` in milliseconds. */
  sample(figures: SideFigures, now: number): void {
    this.latency.value = [LATENCY_BINS_MS, ...this.#latencies.map((window) => histogram(window.values(now)))];
    for (const name of NAMES) {
      const values = figures.map((of) => of && SAMPLED[name](of));
      this.series[name].value = append(this.series[name].peek(), now / 1000, values);
    }
  }
}
