/** Confidence interval of a mean: percentile bootstrap (Efron 1979). */

const RESAMPLES = 4000;

export interface Interval {
  readonly mean: number;
  /** Quantiles that enclose 95 % of the resampled means. */
  readonly low: number;
  readonly high: number;
}

/** For the mean of independent values, such as differences of paired runs. */
export function bootstrap(values: readonly number[], random: () => number): Interval {
  const mean = average(values);
  const means = Array.from({ length: RESAMPLES }, () =>
    average(values.map(() => values[Math.floor(random() * values.length)] ?? 0)),
  ).toSorted((a, b) => a - b);
  const at = (share: number) => means[Math.min(RESAMPLES - 1, Math.floor(share * RESAMPLES))] ?? mean;
  return { mean, low: at(0.025), high: at(0.975) };
}

function average(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / Math.max(1, values.length);
}
