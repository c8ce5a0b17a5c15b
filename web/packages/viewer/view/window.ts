/** Values of the last few seconds, for rates and percentiles. */

/** The nearest-rank percentile (0 to 1) of values, or null without any. */
export function nearestRank(values: readonly number[], rank: number): number | null {
  const sorted = values.toSorted((a, b) => a - b);
  return sorted[Math.max(0, Math.ceil(rank * sorted.length) - 1)] ?? null;
}

export class TimeWindow {
  readonly #span: number;
  #entries: { readonly at: number; readonly value: number }[] = [];

  /** `span` in milliseconds. */
  constructor(span: number) {
    this.#span = span;
  }

  add(value: number, now: number): void {
    this.#entries.push({ at: now, value });
    this.#forget(now);
  }

  clear(): void {
    this.#entries = [];
  }

  values(now: number): number[] {
    this.#forget(now);
    return this.#entries.map(({ value }) => value);
  }

  /** The nearest-rank percentile (0 to 1), or null without values. */
  percentile(rank: number, now: number): number | null {
    return nearestRank(this.values(now), rank);
  }

  /** Time of the last remembered entry; null without any. */
  get latest(): number | null {
    return this.#entries.at(-1)?.at ?? null;
  }

  /** Entries a second, from the first that is remembered until now. */
  rate(now: number): number {
    this.#forget(now);
    const first = this.#entries[0];
    if (first === undefined || this.#entries.length < 2) return 0;
    return ((this.#entries.length - 1) * 1000) / Math.max(1, now - first.at);
  }

  #forget(now: number): void {
    const kept = this.#entries.findIndex(({ at }) => at > now - this.#span);
    if (kept !== 0) this.#entries = kept < 0 ? [] : this.#entries.slice(kept);
  }
}
