/** Values of the last few seconds, for rates and percentiles. */

/** The nearest-rank percentile (0 to 1) of values, or null without any. */
export function nearestRank(values: readonly number[], rank: number): number | null {
  const sorted = new Float64Array(values).sort();
  return sorted[Math.max(0, Math.ceil(rank * sorted.length) - 1)] ?? null;
}

export class TimeWindow {
  readonly #span: number;
  readonly #times: number[] = [];
  readonly #values: number[] = [];

  /** `span` is in milliseconds. */
  constructor(span: number) {
    this.#span = span;
  }

  add(value: number, now: number): void {
    this.#times.push(now);
    this.#values.push(value);
    this.#forget(now);
  }

  values(now: number): readonly number[] {
    this.#forget(now);
    return this.#values;
  }

  /** The nearest-rank percentile (0 to 1), or null without values. */
  percentile(rank: number, now: number): number | null {
    return nearestRank(this.values(now), rank);
  }

  /** Time of the last remembered entry; null without any. */
  get latest(): number | null {
    return this.#times.at(-1) ?? null;
  }

  /** Entries per second, from the first remembered one until now. */
  rate(now: number): number {
    this.#forget(now);
    const { length, 0: first } = this.#times;
    return first === undefined ? 0 : ((length - 1) * 1000) / Math.max(1, now - first);
  }

  #forget(now: number): void {
    while ((this.#times[0] ?? Number.POSITIVE_INFINITY) <= now - this.#span) {
      this.#times.shift();
      this.#values.shift();
    }
  }
}
