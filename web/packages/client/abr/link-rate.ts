/**
 * Rate at which frames get through: their bytes over the time that the link held them, over about the last second.
 *
 * A frame's own first and last byte say little on a bursty link, or where a busy page reads all bytes of a frame at
 * once. But frames that arrive further apart than they were requested have waited: for each, the link needed the rest
 * of the interval, and no more than its delay above the minimum. Where frames arrive as fast as they were requested,
 * only their transmission counts.
 */
import { RecentMinimum } from "./link-delay";

/** Window of the minimum delay, and time constant of the average, in milliseconds. */
const SPAN = 10_000;
const MEMORY = 1000;

export interface FrameOnLink {
  readonly bytes: number;
  /** Time outside the server, from request to last byte, in milliseconds. */
  readonly network: number;
  /** Estimated duration of its transmission, in milliseconds. */
  readonly transmission: number;
  /** Interval at which frames are requested and made, in milliseconds. */
  readonly pace: number;
  readonly at: number;
}

export class LinkRate {
  readonly #least = new RecentMinimum(SPAN);
  #last: number | undefined;
  #bytes = 0;
  #transmission = 0;
  #waited = 0;

  observe({ bytes, network, transmission, pace, at }: FrameOnLink): void {
    const late = network - this.#least.add(network, at);
    const interval = at - (this.#last ?? at);
    this.#last = at;
    const kept = Math.exp(-interval / MEMORY);
    this.#bytes = kept * this.#bytes + bytes;
    this.#transmission = kept * this.#transmission + transmission;
    this.#waited = kept * this.#waited + Math.min(interval - pace, late);
  }

  /** Bits per second; NaN before the first frame. */
  get bitsPerSecond(): number {
    return (this.#bytes * 8000) / Math.max(this.#transmission, this.#waited);
  }
}
