/**
 * The lowest latency at which a stream plays smoothly on the present link: it starts at the preset's, rises by 50 ms on
 * two stalls within 10 s, and falls by 25 ms after each 30 s without a stall. It applies to every player, since it
 * depends only on the frames on screen. Pure.
 */

/** Playback that lost this much on the clock stalled, in milliseconds: three frames of a 60 Hz screen. */
const STALL = 50;
const STALLS = 2;
const WITHIN = 10_000;
const RAISE = 50;
const LOWER = 25;
const LOWER_AFTER = 30_000;
/** A stream that needs more does not count as smooth. */
const MAX = 2000;
/** A stream that begins finds its place first, in milliseconds. */
const GRACE = 2000;

export class LatencyTarget {
  readonly #least: number;
  #value: number;
  #last: { readonly at: number; readonly mediaTime: number } | undefined;
  #stalls: number[] = [];
  #smoothSince: number | undefined;

  /** `least`: the preset's target, in milliseconds. */
  constructor(least: number) {
    this.#least = least;
    this.#value = least;
  }

  /** The target in force, in milliseconds. */
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
    // Frames that last longer in the stream itself, and frames that the browser did not report, are no stalls.
    const lost = at - before.at - (mediaTime - before.mediaTime) * 1000;
    if (lost >= STALL) return this.#stalled(at);
    if (at - this.#smoothSince < LOWER_AFTER) return false;
    this.#smoothSince = at;
    return this.#set(this.#value - LOWER);
  }

  /** The page was hidden: unseen frames are no stalls. */
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
