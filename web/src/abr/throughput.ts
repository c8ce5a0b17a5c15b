/**
 * How fast the link delivers, in bits per second: the exponential moving average (α = 0.3) of the last five measurements.
 *
 * One measurement is what came in between a frame's first and last byte. With several frames in flight their bytes share the
 * link, so the bytes of all of them count: a frame's own bytes alone would make the link look slower than it is.
 *
 * Small frames on a fast link come in one piece and leave nothing to measure. Their link delivers a frame in less than
 * MIN_DURATION, then: a lower bound, which counts where nothing higher is known. Without it, whoever begins with small frames
 * would never learn that larger ones would do.
 */
import type { Arrival } from "../transport/transport";

/** How many measurements of a frame each make an estimate. */
const SAMPLES = 5;
/** Shorter measurements say more about the clock than about the link; they are added up until they are long enough (ms). */
const MIN_DURATION = 2;

/** The exponential moving average (α = 0.3) of the last five values, as the paper has it. */
export class RecentAverage {
  static readonly ALPHA = 0.3;
  #values: number[] = [];

  add(value: number): void {
    this.#values = [...this.#values, value].slice(-SAMPLES);
  }

  /** Null before the first. */
  get value(): number | null {
    const [first, ...rest] = this.#values;
    if (first === undefined) return null;
    return rest.reduce((average, value) => RecentAverage.ALPHA * value + (1 - RecentAverage.ALPHA) * average, first);
  }
}

export class ThroughputEstimator {
  readonly #average = new RecentAverage();
  #bytes = 0;
  #duration = 0;
  /** Frames that came too fast to measure, since the last measurement or bound, and all of their bytes. */
  #fast = 0;
  #fastBytes = 0;

  observe({ firstByteAt, lastByteAt, sharedBytes, bytes }: Omit<Arrival, "sentAt">): void {
    const duration = lastByteAt - firstByteAt;
    this.#bytes += sharedBytes;
    this.#duration += duration;
    if (this.#duration >= MIN_DURATION) {
      this.#add((this.#bytes * 8000) / this.#duration);
      this.#bytes = 0;
      this.#duration = 0;
    } else {
      this.#fast++;
      this.#fastBytes += bytes;
      const bound = (this.#fastBytes * 8000) / (this.#fast * MIN_DURATION);
      if (this.#fast >= SAMPLES && bound > (this.bitsPerSecond ?? 0)) this.#add(bound);
    }
  }

  /** Bits per second, or null before the first measurement. */
  get bitsPerSecond(): number | null {
    return this.#average.value;
  }

  #add(sample: number): void {
    this.#average.add(sample);
    this.#fast = 0;
    this.#fastBytes = 0;
  }
}
