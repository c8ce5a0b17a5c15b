/**
 * Whether enhancing a frame takes longer than the display shows one. Single frames say nothing: the first compile shaders, and
 * any may meet other work. So it is the median of the last ones, or of a few where it is far too long.
 */
import { FrameClock } from "../abr/frame-clock";
import { median } from "./median";

const FRAMES = 15;
const FEW = 5;
const FAR = 3;
/** The display's rate is known after so many animation frames. */
const KNOWN = 31;

export class Pace {
  readonly #clock = new FrameClock();
  #ticks = 0;
  #interval: number | undefined;
  #times: readonly number[] = [];

  /** An animation frame. */
  tick(now: number): void {
    this.#clock.tick(now);
    if (++this.#ticks < KNOWN) return;
    // The shortest that was seen: a graphics processor that has too much to do slows down the animation frames, too.
    this.#interval = Math.min(this.#interval ?? Number.POSITIVE_INFINITY, this.#clock.interval);
  }

  /** Between two of the display's frames, in milliseconds. */
  get interval(): number {
    return this.#interval ?? this.#clock.interval;
  }

  /** A frame was enhanced, in so many milliseconds. Returns the median of the last ones where that is too long, or else null. */
  observe(time: number): number | null {
    this.#times = [...this.#times, time].slice(-FRAMES);
    const usual = median(this.#times);
    const full = this.#times.length === FRAMES && usual > this.interval;
    const far = this.#times.length >= FEW && usual > FAR * this.interval;
    return full || far ? usual : null;
  }

  /** Another model, or another size. */
  reset(): void {
    this.#times = [];
  }
}
