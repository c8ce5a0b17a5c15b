/** Rotation of a simulated camera: it looks around, pauses, and turns fast from time to time. */

const LOOKING = 30;
const QUICK = 150;
/** A quick turn lasts half a second, and follows every six seconds on average (milliseconds). */
const TURN = 500;
const EVERY = 6000;

export class Motion {
  readonly #random: () => number;
  #quickUntil = Number.NEGATIVE_INFINITY;
  #at = 0;

  constructor(random: () => number) {
    this.#random = random;
  }

  /** Turning speed at a time, in degrees per second; times never decrease. */
  speed(now: number): number {
    const elapsed = now - this.#at;
    this.#at = now;
    if (this.#random() < elapsed / EVERY) this.#quickUntil = now + TURN;
    return now < this.#quickUntil ? QUICK : LOOKING * Math.abs(Math.sin(now / 1700));
  }
}
