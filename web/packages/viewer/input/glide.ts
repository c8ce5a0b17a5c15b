/** Spreads a wheel notch over several animation frames. Pure: the elapsed time is an argument. */

/** Time constant in milliseconds, after which about two thirds have been applied. */
const TIME_CONSTANT = 60;
/** Less than this many seconds of walking is given out at once: the end of a jump is no endless stream of frames. */
const LEAST = 0.004;

export class Glide {
  readonly #smooth: () => boolean;
  #rest = 0;

  /** `smooth`: all of it at once otherwise. */
  constructor(smooth: () => boolean) {
    this.#smooth = smooth;
  }

  add(amount: number): void {
    this.#rest += amount;
  }

  /** Amount due after `elapsed` more milliseconds. */
  take(elapsed: number): number {
    if (this.#rest === 0) return 0;
    const left = this.#smooth() ? this.#rest * Math.exp(-elapsed / TIME_CONSTANT) : 0;
    const due = Math.abs(left) < LEAST ? this.#rest : this.#rest - left;
    this.#rest -= due;
    return due;
  }

  stop(): void {
    this.#rest = 0;
  }
}
