/**
 * Whether enhancing takes longer than the display's frame interval. Single frames are unreliable: the first ones
 * compile shaders, and any may coincide with other work. It uses the median of the last ones, or of a few if they are
 * far too long.
 */
import { FrameClock } from "#client/abr/frame-clock";
import { median } from "./median";

const FRAMES = 15;
const FEW = 5;
const FAR = 3;
/** Number of animation frames after which the display's rate is known. */
const KNOWN = 31;

/** The most frames that may be drawn but not released. */
export const MOST_FRAMES = 3;

export class Pace {
  readonly #clock = new FrameClock();
  #ticks = 0;
  #interval: number | undefined;
  #times: readonly number[] = [];

  tick(now: number): void {
    this.#clock.tick(now);
    if (++this.#ticks < KNOWN) return;
    // The shortest interval seen: an overloaded GPU also slows down the animation frames.
    this.#interval = Math.min(this.#interval ?? Number.POSITIVE_INFINITY, this.#clock.interval);
  }

  /** The display's frame interval, in milliseconds. */
  get interval(): number {
    return this.#interval ?? this.#clock.interval;
  }

  /** Records the milliseconds of a frame. Returns the median of the last ones if that is too long, else null. */
  observe(time: number): number | null {
    this.#times = [...this.#times, time].slice(-FRAMES);
    const usual = median(this.#times);
    const full = this.#times.length === FRAMES && usual > this.interval;
    const far = this.#times.length >= FEW && usual > FAR * this.interval;
    return full || far ? usual : null;
  }

  /** Restarts the measurement, for another model or size. */
  reset(): void {
    this.#times = [];
  }
}
