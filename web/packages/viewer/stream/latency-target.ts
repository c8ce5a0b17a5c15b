/**
 * The lowest latency at which a stream plays smoothly on the current link: it starts at the preset's, rises by 50 ms on
 * two stalls within 10 s, and falls by 25 ms after each 30 s without a stall. It applies to every player, since it
 * depends only on the frames on screen. Pure.
 */

/** Playback that falls this far behind the clock has stalled, in milliseconds: three frames of a 60 Hz screen. */
const STALL = 50;
const STALLS = 2;
const WITHIN = 10_000;
const RAISE = 50;
const LOWER = 25;
const LOWER_AFTER = 30_000;
/** A stream that needs more is not smooth. */
const MAX = 2000;
/** Time for a new stream to settle, in milliseconds. */
const GRACE = 2000;

export class LatencyTarget {
  readonly #least: number;
  #value: number;
  #last: { readonly at: number; readonly mediaTime: number } | undefined;
  #stalls: number[] = [];
  #smoothSince: number | undefined;

  /** `least` is the preset's target, in milliseconds. */
  constructor(least: number) {
    this.#least = least;
    this.#value = least;
  }

  /** The current target, in milliseconds. */
  get value(): number {
    return this.#value;
  }

  /**
   * Records a frame on screen: its time in milliseconds, and its position in the stream in seconds. Returns whether the
   * target changed.
   */
  presented(at: number, mediaTime: number): boolean {
    const before = this.#last;
    this.#last = { at, mediaTime };
    this.#smoothSince ??= at + GRACE;
    if (before === undefined || at < this.#smoothSince) return false;
    // Frames that last longer in the stream itself, and frames that the browser did not report, are not stalls.
    const lost = at - before.at - (mediaTime - before.mediaTime) * 1000;
    if (lost >= STALL) return this.#stalled(at);
    if (at - this.#smoothSince < LOWER_AFTER) return false;
    this.#smoothSince = at;
    return this.#set(this.#value - LOWER);
  }

  /** Forgets the last frame after the page was hidden: unseen frames are not stalls. */
  forget(): void {
    this.#last = undefined;
  }

  #stalled(at: number): boolean {
    this.#smoothSince = at;
    this.#stalls = [...this.#stalls.filter((earlier) => earlier > at - WITHIN), at];
    if (this.#stalls.length < STALLS) return false;
    this.#stalls = [];
    return this.#set(this.#value + RAISE);
  }

  #set(value: number): boolean {
    const before = this.#value;
    this.#value = Math.min(MAX, Math.max(this.#least, value));
    return this.#value !== before;
  }
}
