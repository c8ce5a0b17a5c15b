/**
 * Orders the frames of a video for decoding. Each refers to its predecessor, and they may arrive out of order or not at
 * all, so a frame waits for its predecessor for a short time. After that only a key frame helps, which is requested
 * once until that request has an answer. Pure: time is an argument, in milliseconds.
 */

/** A frame's place in the video. */
export interface Link {
  readonly seq: number;
  /** Whether it refers to no other frame. */
  readonly key: boolean;
  /** Number of the reference frame; null for a key frame. */
  readonly after: number | null;
}

/** Effect of a received frame: frames that can be decoded now, in order, and frames that never can. */
export interface Outcome<Frame> {
  readonly ready: readonly Frame[];
  readonly lost: readonly Frame[];
}

interface Waiting<Frame> {
  readonly frame: Frame;
  readonly since: number;
}

export class Chain<Frame extends Link> {
  /** The last decodable frame; null if only a key frame can be decoded. */
  #last: number | null = null;
  #waiting: readonly Waiting<Frame>[] = [];
  /** The unanswered request for a key frame. */
  #asked: number | null = null;
  /** Requests that ended without a frame; frames that refer to them are useless. */
  readonly #without = new Set<number>();

  /** Whether only a key frame can be decoded. */
  get broken(): boolean {
    return this.#last === null;
  }

  /** Records a request; returns whether it must ask for a key frame. */
  asks(seq: number): boolean {
    if (!this.broken || this.#asked !== null) return false;
    this.#asked = seq;
    return true;
  }

  /** Takes a received frame. */
  add(frame: Frame, now: number): Outcome<Frame> {
    if (frame.seq === this.#asked || frame.key) this.#asked = null;
    if (this.#last !== null && frame.seq <= this.#last) return { ready: [], lost: [frame] };
    if (frame.key || (this.#last !== null && frame.after === this.#last)) {
      const ready = [frame, ...this.#follow(frame)];
      return { ready, lost: this.#take(({ seq }) => seq < (ready.at(-1) ?? frame).seq) };
    }
    this.#waiting = [...this.#waiting, { frame, since: now }];
    return { ready: [], lost: this.#orphans() };
  }

  /** Records that a request was refused, cancelled or lost. Returns the frames that waited for it. */
  ended(seq: number): readonly Frame[] {
    if (seq === this.#asked) this.#asked = null;
    if (this.#last !== null && seq < this.#last) return [];
    this.#without.add(seq);
    return this.#orphans();
  }

  /** Returns frames that waited longer than `patience`, and all frames that depend on them. */
  expired(now: number, patience: number): readonly Frame[] {
    return this.#waiting.some(({ since }) => now - since > patience) ? this.break() : [];
  }

  /** Records that only a key frame helps from now on. Returns the frames that waited. */
  break(): readonly Frame[] {
    this.#last = null;
    return this.#take(() => true);
  }

  /** Frames that wait for a missing frame. */
  #orphans(): readonly Frame[] {
    const orphaned = this.#waiting.some(({ frame: { after } }) => after !== null && this.#without.has(after));
    return orphaned ? this.break() : [];
  }

  /** Continues from a frame. Returns the waiting frames that follow it. */
  #follow({ seq }: Frame): Frame[] {
    const following: Frame[] = [];
    for (let last: number | undefined = seq; last !== undefined; ) {
      this.#last = last;
      const [next]: readonly Frame[] = this.#take(({ after }) => after === last);
      if (next) following.push(next);
      last = next?.seq;
    }
    for (const old of this.#without) if (old < (this.#last ?? 0)) this.#without.delete(old);
    return following;
  }

  #take(which: (frame: Frame) => boolean): readonly Frame[] {
    const taken = this.#waiting.filter(({ frame }) => which(frame));
    this.#waiting = this.#waiting.filter(({ frame }) => !which(frame));
    return taken.map(({ frame }) => frame);
  }
}
