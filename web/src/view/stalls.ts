/**
 * Stalls: while the camera moves, the picture stands still for longer than a person overlooks. The same for every mode: the
 * gap between two presented frames of different poses counts for as long as the camera moved in it, if it moved when the gap
 * began. (If it began to move later, the wait for the first frame is latency.)
 */

/** A longer gap than this is a stall, in milliseconds: six frames at 30 frames/s. */
export const STALL_AFTER = 200;
/** A camera that did not move for this long stands still, in milliseconds. */
const STILL_AFTER = 100;

export interface Stalls {
  readonly count: number;
  /** All of them together, in milliseconds. */
  readonly time: number;
}

export class StallDetector {
  #movingSince: number | undefined;
  #movedAt = Number.NEGATIVE_INFINITY;
  #presentedAt = Number.NEGATIVE_INFINITY;
  #stalls = { count: 0, time: 0 };

  get stalls(): Stalls {
    return this.#stalls;
  }

  moved(at: number): void {
    if (at - this.#movedAt > STILL_AFTER) this.#movingSince = at;
    this.#movedAt = at;
  }

  presented(at: number): void {
    const stood = Math.min(at, this.#movedAt) - this.#presentedAt;
    const moving = this.#movingSince !== undefined && this.#movingSince <= this.#presentedAt;
    if (moving && stood > STALL_AFTER) {
      this.#stalls = { count: this.#stalls.count + 1, time: this.#stalls.time + stood };
    }
    this.#presentedAt = at;
  }
}
