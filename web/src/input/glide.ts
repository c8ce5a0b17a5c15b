/** Spreads the jump of a wheel's notch over a few animation frames. Pure: the time that passed comes in. */

/** After this many milliseconds about two thirds of what was asked have been given out. */
const TIME_CONSTANT = 60;
/** Less than this many seconds of walking is given out at once: the end of a jump is no endless stream of frames. */
const LEAST = 0.004;

export class Glide {
  #rest = 0;

  add(amount: number): void {
    this.#rest += amount;
  }

  /** What is due after `elapsed` more milliseconds; all of it if `smooth` is not wanted. */
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
