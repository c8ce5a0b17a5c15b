/**
 * The frames of a video in the order in which they were encoded. Each refers to the one before it, and they may come in another order
 * or not at all, so a frame waits for the one before it, and not for long: from then on only a key frame helps, which is asked for once
 * until that request has an answer. Pure: times come in, in milliseconds.
 */

/** A frame's place in the video. */
export interface Link {
  readonly seq: number;
  /** It refers to no other. */
  readonly key: boolean;
  /** The number of the one that it refers to; null of a key frame. */
  readonly after: number | null;
}

/** What has become of frames with the one that came: in order, those that can be decoded now, and those that never will be. */
export interface Outcome<Frame> {
  readonly ready: readonly Frame[];
  readonly lost: readonly Frame[];
}

interface Waiting<Frame> {
  readonly frame: Frame;
  readonly since: number;
}

export class Chain<Frame extends Link> {
  /** The last one that could be decoded; null: only a key frame can be. */
  #last: number | null = null;
  #waiting: readonly Waiting<Frame>[] = [];
  /** The request that asked for a key frame and has no answer yet. */
  #asked: number | null = null;
  /** Requests that ended without a frame: what refers to one of them is of no use. */
  readonly #without = new Set<number>();

  /** Whether only a key frame can be decoded. */
  get broken(): boolean {
    return this.#last === null;
  }

  /** A request goes out: whether it is to ask for a key frame. */
  asks(seq: number): boolean {
    if (!this.broken || this.#asked !== null) return false;
    this.#asked = seq;
    return true;
  }

  /** A frame came. */
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

  /** A request ended without a frame: it was refused, cancelled, or lost. Returns the frames that waited for it. */
  ended(seq: number): readonly Frame[] {
    if (seq === this.#asked) this.#asked = null;
    if (this.#last !== null && seq < this.#last) return [];
    this.#without.add(seq);
    return this.#orphans();
  }

  /** Returns what has waited for longer than `patience`, and all else that waits with it. */
  expired(now: number, patience: number): readonly Frame[] {
    return this.#waiting.some(({ since }) => now - since > patience) ? this.break() : [];
  }

  /** Only a key frame helps from now on. Returns the frames that waited. */
  break(): readonly Frame[] {
    this.#last = null;
    return this.#take(() => true);
  }

  /** Those that wait for a frame that will never come. */
  #orphans(): readonly Frame[] {
    const orphaned = this.#waiting.some(({ frame: { after } }) => after !== null && this.#without.has(after));
    return orphaned ? this.break() : [];
  }

  /** Goes on from a frame. Returns the waiting ones that follow it. */
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
