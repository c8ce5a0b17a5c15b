/**
 * The interval between animation frames: the median of the last ones, which the gap of a hidden page does not change.
 * 60 per second until some have arrived.
 */

const SAMPLES = 31;
const ENOUGH = 5;
const AT_60_HZ = 1000 / 60;

export class FrameClock {
  #last: number | undefined;
  readonly #intervals: number[] = [];
  /** The same intervals, kept sorted because several clocks tick in each animation frame. */
  readonly #sorted: number[] = [];

  /** Records the time of an animation frame, in milliseconds; times never decrease. */
  tick(now: number): void {
    const interval = now - (this.#last ?? now);
    this.#last = now;
    if (interval <= 0) return;
    this.#intervals.push(interval);
    if (this.#intervals.length > SAMPLES) this.#sorted.splice(this.#sorted.indexOf(this.#intervals.shift() ?? 0), 1);
    const above = this.#sorted.findIndex((other) => other > interval);
    this.#sorted.splice(above < 0 ? this.#sorted.length : above, 0, interval);
  }

  /** The interval in milliseconds. */
  get interval(): number {
    const { length } = this.#sorted;
    return (length >= ENOUGH && this.#sorted[length >> 1]) || AT_60_HZ;
  }
}
