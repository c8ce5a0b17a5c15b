/** Distribution of the camera's recent turning speeds. */

/** Upper ends of the classes, and the speeds that stand for them, in degrees a second. */
const ENDS = [2, 7, 15, 27, 47, 80, 140, Number.POSITIVE_INFINITY];
const SPEEDS = [1, 4, 10, 20, 35, 60, 100, 180];
/** Time constant of the average, in milliseconds. */
const MEMORY = 2000;

export class TurningSpeeds {
  #shares: readonly number[] = SPEEDS.map(() => 1 / SPEEDS.length);
  #at = Number.NEGATIVE_INFINITY;

  /** A speed in degrees a second, at a time in milliseconds. */
  observe(speed: number, at: number): void {
    const kept = Math.exp((this.#at - at) / MEMORY);
    this.#at = at;
    const own = ENDS.findIndex((end) => speed < end);
    this.#shares = this.#shares.map((share, i) => kept * share + (i === own ? 1 - kept : 0));
  }

  /** Expected value of a function of the speed. */
  expect(value: (speed: number) => number): number {
    return this.#shares.reduce((sum, share, i) => (share > 0 ? sum + share * value(SPEEDS[i] ?? 0) : sum), 0);
  }
}
