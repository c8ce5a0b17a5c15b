/**
 * The time between animation frames, as they come: the median of the last ones, which the gap of a hidden page does not
 * change. 60 a second until some have come.
 */

const SAMPLES = 31;
const ENOUGH = 5;
const AT_60_HZ = 1000 / 60;

export class FrameClock {
  #last: number | undefined;
  readonly #intervals: number[] = [];
  /** The same ones, ascending: several clocks tick in each animation frame. */
  readonly #sorted: number[] = [];

  /** An animation frame, in milliseconds; times never go back. */
  tick(now: number): void {
    const interval = now - (this.#last ?? now);
    this.#last = now;
    if (interval <= 0) return;
    this.#intervals.push(interval);
    if (this.#intervals.length > SAMPLES) this.#sorted.splice(this.#sorted.indexOf(this.#intervals.shift() ?? 0), 1);
    const above = this.#sorted.findIndex((other) => other > interval);
    this.#sorted.splice(above < 0 ? this.#sorted.length : above, 0, interval);
  }

  /** Milliseconds. */
  get interval(): number {
    const { length } = this.#sorted;
    return (length >= ENOUGH && this.#sorted[length >> 1]) || AT_60_HZ;
  }
}
