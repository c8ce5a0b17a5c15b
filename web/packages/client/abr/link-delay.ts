/**
 * Time that frames spend outside the server beyond their own transmission: propagation both ways, jitter and queueing
 * on the link. The queue is the average delay above the recent minimum; jitter is the interarrival jitter of RFC 3550,
 * the average change from frame to frame. All in milliseconds.
 */

/** The minimum of the values of the last milliseconds. */
export class RecentMinimum {
  readonly #span: number;
  /** Possible minima: ascending in time and value. */
  #values: { readonly at: number; readonly value: number }[] = [];

  /** `span` in milliseconds. */
  constructor(span: number) {
    this.#span = span;
  }

  /** Adds a value at a time that never decreases; returns the minimum, which may be this value. */
  add(value: number, at: number): number {
    this.#values = this.#values.filter((older) => older.at > at - this.#span && older.value < value);
    this.#values.push({ at, value });
    return this.#values[0]?.value ?? value;
  }
}

/** Window of the minimum, in milliseconds. */
const SPAN = 10_000;
const ALPHA = 0.3;
/** The gain of RFC 3550. */
const JITTER_ALPHA = 1 / 16;
/** Minimum number of frames in an average. */
const ENOUGH = 5;

export class LinkDelay {
  readonly #least = new RecentMinimum(SPAN);
  /** Mean delay of the last frames. */
  average = 0;
  #last: number | undefined;
  #queue = 0;
  jitter = 0;
  /** Number of frames observed since the last restart. */
  frames = 0;

  observe(delay: number, at: number): void {
    if (this.#last !== undefined) this.jitter += JITTER_ALPHA * (Math.abs(delay - this.#last) - this.jitter);
    this.#last = delay;
    this.average = this.frames === 0 ? delay : this.average + ALPHA * (delay - this.average);
    this.frames++;
    if (this.frames >= ENOUGH) this.#queue = this.average - this.#least.add(this.average, at);
  }

  get queue(): number {
    return this.#queue;
  }

  /** Restarts the averages, since different frames follow. */
  restart(): void {
    this.frames = 0;
    this.#queue = 0;
  }
}
