/**
 * Throughput of the link in bits per second: the exponential moving average (α = 0.3) of the last five measurements.
 *
 * A measurement counts all bytes received between a frame's first and last byte. Frames in flight share the link, so a
 * frame's own bytes alone would underestimate it.
 *
 * Single small frames are unreliable: two packets half a millisecond apart may be delivered together, or milliseconds
 * apart. The error evens out over several frames, provided that frames delivered at once count with their bytes beyond
 * one packet. Bytes and durations are therefore summed until there are enough.
 *
 * Frames of one packet leave nothing to measure, and neither does a very fast link, which delivers a frame in less than
 * MIN_DURATION. Such a frame gives a lower bound, used where nothing higher is known. Without it, a controller that
 * starts with small frames would never learn that larger ones fit.
 */
import type { Arrival } from "../transport/transport";

/** The most frames that are summed for one measurement. */
const TOGETHER = 30;
/** Number of measurements in an estimate. */
const SAMPLES = 5;
/** Shorter measurements measure the clock rather than the link; they are added up until they are long enough (ms). */
const MIN_DURATION = 2;

/** The exponential moving average (α = 0.3) of the last five values, as the paper has it. */
export class RecentAverage {
  static readonly ALPHA = 0.3;
  #values: number[] = [];
  /** Null before the first. */
  value: number | null = null;

  add(value: number): void {
    this.#values = [...this.#values, value].slice(-SAMPLES);
    this.value = this.#values.reduce((average, one) => RecentAverage.ALPHA * one + (1 - RecentAverage.ALPHA) * average);
  }
}

export class ThroughputEstimator {
  readonly #average = new RecentAverage();
  #bytes = 0;
  #duration = 0;
  #frames = 0;
  /** Number and bytes of frames that arrived too fast to measure, since the last measurement or bound. */
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
