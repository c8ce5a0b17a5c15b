/**
 * How fast the link delivers, in bits per second: the exponential moving average (α = 0.3) of the last five measurements.
 *
 * One measurement is what came in between a frame's first and last byte. With several frames in flight their bytes share the
 * link, so the bytes of all of them count: a frame's own bytes alone would make the link look slower than it is.
 */
import type { Arrival } from "../transport/transport";

const ALPHA = 0.3;
const SAMPLES = 5;
/** Shorter measurements say more about the clock than about the link; they are added up until they are long enough (ms). */
const MIN_DURATION = 2;

export class ThroughputEstimator {
  #samples: number[] = [];
  #bytes = 0;
  #duration = 0;

  observe({ firstByteAt, lastByteAt, sharedBytes }: Pick<Arrival, "firstByteAt" | "lastByteAt" | "sharedBytes">): void {
    this.#bytes += sharedBytes;
    this.#duration += lastByteAt - firstByteAt;
    if (this.#duration < MIN_DURATION) return;
    this.#samples = [...this.#samples, (this.#bytes * 8000) / this.#duration].slice(-SAMPLES);
    this.#bytes = 0;
    this.#duration = 0;
  }

  /** Bits per second, or null before the first measurement. */
  get bitsPerSecond(): number | null {
    const [first, ...rest] = this.#samples;
    if (first === undefined) return null;
    return rest.reduce((average, sample) => ALPHA * sample + (1 - ALPHA) * average, first);
  }
}
