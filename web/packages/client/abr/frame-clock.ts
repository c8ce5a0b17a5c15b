/**
 * The time between animation frames, as they come: the median of the last ones, which the gap of a hidden page does not
 * change. 60 a second until some have come.
 */

const SAMPLES = 31;
const ENOUGH = 5;
const AT_60_HZ = 1000 / 60;

export class FrameClock {
  #last: number | undefined;
  #intervals: number[] = [];
  #median = AT_60_HZ;

  /** An animation frame, in milliseconds; times never go back. */
  tick(now: number): void {
    const interval = now - (this.#last ?? now);
    this.#last = now;
    if (interval <= 0) return;
    this.#intervals = [...this.#intervals, interval].slice(-SAMPLES);
    if (this.#intervals.length < ENOUGH) return;
    this.#median = this.#intervals.toSorted((a, b) => a - b)[this.#intervals.length >> 1] ?? AT_60_HZ;
  }

  /** Milliseconds. */
  get interval(): number {
    return this.#median;
  }
}
