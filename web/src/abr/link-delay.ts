/**
 * What frames spend outside the server beyond their own transmission: the way there and back, jitter, and the queue on the link.
 * The queue is by how much the average is above the least that it was lately; jitter is what RFC 3550 calls interarrival jitter,
 * the average of how much it changes from frame to frame. All in milliseconds.
 */
import { RecentMinimum } from "./recent-minimum";

/** The least is that of so many milliseconds. */
const SPAN = 10_000;
/** Weight of the newest frame in the average. */
const ALPHA = 0.3;
/** As RFC 3550 has it. */
const JITTER_ALPHA = 1 / 16;
/** An average of fewer frames is none. */
const ENOUGH = 5;

export class LinkDelay {
  #least = new RecentMinimum(SPAN);
  /** Of the last ones. */
  average = 0;
  #last: number | undefined;
  #queue = 0;
  jitter = 0;
  /** How many were heard of since the last restart. */
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

  /** The frames that come now are others: average them anew. */
  restart(): void {
    this.frames = 0;
    this.#queue = 0;
  }

  /** What is now is how it is from now on. */
  forget(): void {
    this.#least = new RecentMinimum(SPAN);
    this.restart();
  }
}
