/**
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
