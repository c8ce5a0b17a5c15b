/**
 * Asks for no more than so many bits a second, in the long run. A frame counts as large as those of late when it is asked for, and as
 * large as it is when it has come, so that requests are spread evenly and what was too much is waited for.
 */

/** How much the newest frame counts in the usual size. */
const NEWEST = 0.2;
/** The first frames count as if so many milliseconds lay between them. */
const GUESSED_APART = 50;
/** More are never under way: those before them will not come. */
const MOST = 64;

export class RateCap {
  /** Bytes that are ahead of the rate; what was saved up is less than nothing. */
  #ahead = 0;
  /** Of a frame, in bytes; 0 until one has come. */
  #usual = 0;
  #guess = 0;
  /** What those counted that have not come. */
  readonly #charged: number[] = [];
  #at = 0;

  /** Whether another frame may be asked for; `kbps`: null is no cap. Time is in milliseconds. */
  allows(kbps: number | null, now: number): boolean {
    const elapsed = now - this.#at;
    this.#at = now;
    this.#guess = ((kbps ?? 0) * GUESSED_APART) / 8;
    // What was not made use of is saved up for one frame: they are asked for once per animation frame, which may be a little late.
    this.#ahead = kbps === null ? 0 : Math.max(-this.#usual, this.#ahead - (kbps * elapsed) / 8);
    return this.#ahead <= 0;
  }

  /** A frame was asked for. */
  asked(): void {
    const size = this.#usual || this.#guess;
    this.#ahead += size;
    this.#charged.push(size);
    if (this.#charged.length > MOST) this.#charged.shift();
  }

  /** One that was asked for has come; those that never do have counted all the same. */
  came(bytes: number): void {
    this.#ahead += bytes - (this.#charged.shift() ?? 0);
    this.#usual = this.#usual === 0 ? bytes : this.#usual + NEWEST * (bytes - this.#usual);
  }

  /** So many bytes came besides. */
  besides(bytes: number): void {
    this.#ahead += bytes;
  }
}
