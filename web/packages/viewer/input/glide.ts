/** Spreads a wheel notch over several animation frames. Pure: the elapsed time is an argument. */

/** Time constant in milliseconds, after which about two thirds have been applied. */
const TIME_CONSTANT = 60;
/** Less than this many seconds of walking is given out at once: the end of a jump is no endless stream of frames. */
const LEAST = 0.004;

export class Glide {
  #rest = 0;

  add(amount: number): void {
    this.#rest += amount;
  }

  /** Amount due after `elapsed` more milliseconds; all of it unless `smooth`. */
  take(elapsed: number, smooth: boolean): number {
    const left = smooth ? this.#rest * Math.exp(-elapsed / TIME_CONSTANT) : 0;
    const due = Math.abs(left) < LEAST ? this.#rest : this.#rest - left;
    this.#rest -= due;
    return due;
  }

  stop(): void {
    this.#rest = 0;
  }
}
