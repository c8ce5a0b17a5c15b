/**
 * One direction of the shaped link: a first-in-first-out queue of bounded bytes in front of a rate that follows a
 * trace.
 *
 * It works in units of capacity: C(t) is the number of bytes that the link could have carried until t. A packet departs
 * when C reaches the sum of all bytes up to it, so its departure is known on arrival, and the queue is that sum less
 * C(now).
 */
import type { NetworkTrace } from "./trace";

/** Time to drain a full queue at the trace's mean rate, in milliseconds. */
export const QUEUE_MS = 150;
/** The smallest capacity of a queue, in bytes: eight full packets. */
const MIN_QUEUE = 8 * 1514;

export class Bottleneck {
  readonly #capacity: Capacity;
  readonly #departures: Capacity;
  readonly #limit: number;
  /** The value of C, in bits, at which everything has been sent. */
  #through = 0;

  constructor(trace: NetworkTrace, direction: "down_kbps" | "up_kbps") {
    this.#capacity = new Capacity(trace, direction);
    this.#departures = new Capacity(trace, direction);
    this.#limit = 8 * Math.max(MIN_QUEUE, (this.#capacity.mean * QUEUE_MS) / 8);
  }

  /** A packet arrives; returns its departure, or null if the queue is full. Times must not decrease. */
  offer(bytes: number, now: number): number | null {
    const passed = this.#capacity.until(now);
    const queued = Math.max(0, this.#through - passed);
    if (queued + bytes * 8 > this.#limit) return null;
    this.#through = passed + queued + bytes * 8;
    return this.#departures.reached(this.#through);
  }

  /** The time when everything queued will have left. */
  get drained(): number {
    return this.#departures.reached(this.#through);
  }
}

/** The integral of a trace's rate, and its inverse; both for arguments that never decrease. */
class Capacity {
  readonly #starts: readonly number[];
  readonly #rates: readonly number[];
  readonly #bits: readonly number[];
  readonly #duration: number;
  readonly #lapBits: number;
  #i = 0;
  #lap = 0;

  constructor({ steps, duration }: NetworkTrace, direction: "down_kbps" | "up_kbps") {
    this.#starts = steps.map(({ t_ms }) => t_ms);
    this.#rates = steps.map((step) => step[direction]);
    let sum = 0;
    const bits: number[] = [];
    for (const [i, step] of steps.entries()) {
      bits.push(sum);
      sum += step[direction] * ((steps[i + 1]?.t_ms ?? duration) - step.t_ms);
    }
    this.#bits = bits;
    this.#duration = duration;
    this.#lapBits = sum;
  }

  /** kbit/s, which are bits per millisecond. */
  get mean(): number {
    return this.#lapBits / this.#duration;
  }

  until(time: number): number {
    while (time >= (this.#lap + 1) * this.#duration) this.#nextLap();
    const within = time - this.#lap * this.#duration;
    while ((this.#starts[this.#i + 1] ?? Number.POSITIVE_INFINITY) <= within) this.#i++;
    return this.#lap * this.#lapBits + this.#at(this.#bits) + this.#at(this.#rates) * (within - this.#at(this.#starts));
  }

  reached(bits: number): number {
    while (bits > (this.#lap + 1) * this.#lapBits) this.#nextLap();
    const within = bits - this.#lap * this.#lapBits;
    while ((this.#bits[this.#i + 1] ?? Number.POSITIVE_INFINITY) < within) this.#i++;
    const rate = this.#at(this.#rates);
    const since = rate === 0 ? 0 : (within - this.#at(this.#bits)) / rate;
    return this.#lap * this.#duration + this.#at(this.#starts) + since;
  }

  #nextLap(): void {
    this.#lap++;
    this.#i = 0;
  }

  #at(values: readonly number[]): number {
    return values[this.#i] as number;
  }
}
