/**
 * How fast the link delivers, in bits per second: the exponential moving average (α = 0.3) of the last five measurements.
 *
 * One measurement is what came in between a frame's first and last byte. With several frames in flight their bytes share the
 * link, so the bytes of all of them count: a frame's own bytes alone would make the link look slower than it is.
 *
 * Small frames say little one by one: two packets that are half a millisecond apart are heard of at once, or in two pieces
 * some milliseconds apart. Over several frames the error evens out, if those that came at once count with what they had beyond
 * a packet, and so bytes and durations are added up until there is enough.
 *
 * Frames of a packet leave nothing to measure, and neither does a link that is fast enough. Such a link delivers a frame in
 * less than MIN_DURATION: a lower bound, which counts where nothing higher is known. Without it, whoever begins with small
 * frames would never learn that larger ones would do.
 */
import type { Arrival } from "../transport/transport";

/** So many frames without a long enough measurement are forgotten. */
const TOGETHER = 30;
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
  #frames = 0;
  /** Frames that came too fast to measure, since the last measurement or bound, and all of their bytes. */
  #fast = 0;
  #fastBytes = 0;

  observe({ firstByteAt, lastByteAt, sharedBytes, bytes }: Omit<Arrival, "sentAt">): void {
    const duration = lastByteAt - firstByteAt;
    this.#bytes += sharedBytes;
    this.#duration += duration;
    this.#frames++;
    if (this.#duration >= MIN_DURATION) {
      this.#add((this.#bytes * 8000) / this.#duration);
      this.#restart();
    } else {
      if (this.#frames >= TOGETHER) this.#restart();
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

  #restart(): void {
    this.#bytes = 0;
    this.#duration = 0;
    this.#frames = 0;
  }

  #add(sample: number): void {
    this.#average.add(sample);
    this.#fast = 0;
    this.#fastBytes = 0;
  }
}
