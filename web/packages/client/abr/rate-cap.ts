/**
 * Limits the long-term rate of requested bytes. A frame counts with the recent average size when it is requested and
 * with its true size once it has arrived, so requests are spread evenly and any excess is waited out.
 */

/** Weight of the newest frame in the usual size. */
const NEWEST = 0.2;
/** Assumed interval between the first frames, in milliseconds. */
const GUESSED_APART = 50;
/** The most frames in flight: earlier ones will not arrive. */
const MOST = 64;

export class RateCap {
  /** Bytes ahead of the rate; negative when there are savings. */
  #ahead = 0;
  /** Usual size of a frame, in bytes; 0 until one has arrived. */
  #usual = 0;
  #guess = 0;
  /** Bytes counted for frames that have not arrived. */
  readonly #charged: number[] = [];
  #at = 0;

  /** Whether another frame may be requested; a null `kbps` is no cap. Time is in milliseconds. */
  allows(kbps: number | null, now: number): boolean {
    const elapsed = now - this.#at;
    this.#at = now;
    this.#guess = ((kbps ?? 0) * GUESSED_APART) / 8;
    // Unused rate is saved for one frame: requests go out once per animation frame, which may be slightly late.
    this.#ahead = kbps === null ? 0 : Math.max(-this.#usual, this.#ahead - (kbps * elapsed) / 8);
    return this.#ahead <= 0;
  }

  /** Records a request for a frame. */
  asked(): void {
    const size = this.#usual || this.#guess;
    this.#ahead += size;
    this.#charged.push(size);
    if (this.#charged.length > MOST) this.#charged.shift();
  }

  /** Corrects the count for a frame that has arrived; frames that never arrive stay counted. */
  came(bytes: number): void {
    this.#ahead += bytes - (this.#charged.shift() ?? 0);
    this.#usual = this.#usual === 0 ? bytes : this.#usual + NEWEST * (bytes - this.#usual);
  }

  besides(bytes: number): void {
    this.#ahead += bytes;
  }
}
