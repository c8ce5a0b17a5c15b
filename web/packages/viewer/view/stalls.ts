/**
 * Stalls: while the camera moves, the picture stands still long enough to be noticed. The same for every mode: the gap
 * between two presented frames of different poses counts while the camera moves in it, if the camera moved when the gap
 * began. (If it started to move later, the wait for the first frame is latency.)
 */

/** A longer gap than this is a stall, in milliseconds: six frames at 30 frames/s. */
const STALL_AFTER = 200;
/** A camera that did not move for this long stands still, in milliseconds. */
const STILL_AFTER = 100;

export interface Stalls {
  readonly count: number;
  /** Total duration of all stalls, in milliseconds. */
  readonly time: number;
}

export class StallDetector {
  #movingSince: number | undefined;
  #movedAt = Number.NEGATIVE_INFINITY;
  #presentedAt = Number.NEGATIVE_INFINITY;
  #stalls = { count: 0, time: 0 };

  /** All stalls, including an ongoing one at the given time. */
  stalls(at: number): Stalls {
    const { count, time } = this.#stalls;
    const stood = this.#stood(at);
    return stood > STALL_AFTER ? { count: count + 1, time: time + stood } : this.#stalls;
  }

  moved(at: number): void {
    if (at - this.#movedAt > STILL_AFTER) this.#movingSince = at;
    this.#movedAt = at;
  }

  presented(at: number): void {
    this.#stalls = this.stalls(at);
    this.#presentedAt = at;
  }

  /** For how long the picture has stood still while the camera moved, in milliseconds. */
  #stood(at: number): number {
    const moving = this.#movingSince !== undefined && this.#movingSince <= this.#presentedAt;
    return moving ? Math.min(at, this.#movedAt) - this.#presentedAt : 0;
  }
}
