/** Spreads a wheel notch over several animation frames. Pure: the elapsed time is an argument. */

/** Time constant in milliseconds, after which about two thirds have been applied. */
const TIME_CONSTANT = 60;
/** A rest below this many seconds of walking is applied at once, so that a jump does not tail off in endless frames. */
const LEAST = 0.004;

export class Glide {
  readonly #smooth: () => boolean;
  #rest = 0;

  /** Unless `smooth`, everything is applied at once. */
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
