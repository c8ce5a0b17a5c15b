/** Keeps playback at a latency: a little faster, a little slower, or a jump. Pure. */

/** Number of answers remembered, since clocks slowly drift apart. */
const REMEMBERED = 8;

export class ServerClock {
  #answers: { readonly roundTrip: number; readonly offset: number }[] = [];

  /** Records the server's `time` in Unix milliseconds, with the times of request and answer on the page's clock. */
  heard(time: number, askedAt: number, heardAt: number): void {
    const answer = { roundTrip: heardAt - askedAt, offset: time - (askedAt + heardAt) / 2 };
    this.#answers = [...this.#answers.slice(1 - REMEMBERED), answer];
  }

  /** The server's time, in Unix milliseconds, at a moment of the page's clock; NaN before the first answer. */
  at(now: number): number {
    const [best] = this.#answers.toSorted((a, b) => a.roundTrip - b.roundTrip);
    return now + (best?.offset ?? Number.NaN);
  }
}

/** Distance behind the end of the buffer in seconds: at the start of playback, and the minimum. */
export const MARGIN = 0.02;
/** Tolerance around the target, in seconds. */
const NEAR = 0.015;
/** Delays beyond this many seconds are caught up by a jump instead of faster playback. */
const FAR = 0.25;
/** Shortest time between jumps, in seconds: a jump decodes all frames since the last keyframe, too much for a slow machine to repeat. */
const JUMP_EVERY = 2;
const FASTER = 1.05;
const SLOWER = 0.95;

export interface Playback {
  /** On the media timeline, all in seconds. */
  readonly position: number;
  /** End of the buffer. */
  readonly end: number;
  readonly live: number;
  /** Distance to keep between `position` and `live`. */
  readonly target: number;
}

export class Pace {
  #rate = 1;
  #jumpedAt = Number.NEGATIVE_INFINITY;

  /** The position to jump to, or else the playback rate. */
  next({ position, end, live, target }: Playback): { readonly jump: number } | { readonly rate: number } {
    const behind = live - position - target;
    const ahead = end - position;
    if (behind > FAR && ahead > FAR && live - this.#jumpedAt > JUMP_EVERY) {
      this.#rate = 1;
      this.#jumpedAt = live;
      return { jump: end - MARGIN };
    }
    if (behind > NEAR) this.#rate = FASTER;
    else if (behind < -NEAR) this.#rate = SLOWER;
    else if (this.#rate > 1 ? behind < 0 : behind > 0) this.#rate = 1; // it has crossed the target
    if (this.#rate > 1 && ahead <= MARGIN) this.#rate = 1; // the buffer has run dry
    return { rate: this.#rate };
  }
}
