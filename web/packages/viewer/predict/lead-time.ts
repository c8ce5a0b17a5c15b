/**
 * Prediction horizon of requests: the recent time from request to screen, plus half the time until the next frame
 * replaces it. Pure: time is an argument, in milliseconds on one clock.
 */

/** Number of frames averaged: few enough to follow the network, enough to ignore a late one. */
const FRAMES = 15;
/** No pose is predicted farther ahead than this. */
const LONGEST = 500;
/** A frame that stays longer has no successor: the camera rests. */
const LONGEST_STAY = 250;

export class LeadTime {
  #delays: number[] = [];
  #stays: number[] = [];
  #shownAt: number | undefined;
  #askedAt = Number.NEGATIVE_INFINITY;

  /** A frame requested at a given time is on screen; repeats (a video at rest) are ignored. */
  shown(askedAt: number, at: number): void {
    if (askedAt <= this.#askedAt) return;
    this.#askedAt = askedAt;
    this.#delays = [...this.#delays, at - askedAt].slice(-FRAMES);
    const stay = at - (this.#shownAt ?? Number.NEGATIVE_INFINITY);
    if (stay <= LONGEST_STAY) this.#stays = [...this.#stays, stay].slice(-FRAMES);
    this.#shownAt = at;
  }

  /** Whether any frame was shown. */
  get known(): boolean {
    return this.#delays.length > 0;
  }

  /** In milliseconds; 0 until a frame was shown. */
  get ahead(): number {
    return Math.min(LONGEST, Math.max(0, median(this.#delays) + median(this.#stays) / 2));
  }

  /** New connection: resets the estimate. */
  clear(): void {
    this.#delays = [];
    this.#stays = [];
    this.#shownAt = undefined;
    this.#askedAt = Number.NEGATIVE_INFINITY;
  }
}

function median(values: readonly number[]): number {
  const sorted = values.toSorted((a, b) => a - b);
  return sorted[values.length >> 1] ?? 0;
}
