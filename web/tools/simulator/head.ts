/** The turns of the simulated camera, from recorded head movement. */
import { poseAt, type TimedPose } from "#viewer/movement/movement";
import { angleBetween } from "#viewer/view/vector";

/** Window of the speeds, in milliseconds. */
const SPAN = 1000 / 60;

export class Head {
  readonly #points: readonly TimedPose[];
  readonly #start: number;
  readonly #duration: number;

  /** A movement from a time in milliseconds on, repeated at its end. */
  constructor(points: readonly TimedPose[], start: number) {
    this.#points = points;
    this.#start = start;
    this.#duration = Math.max(1, points.at(-1)?.t_ms ?? 0);
  }

  /** Turning speed at a time, in degrees per second. */
  speed(now: number): number {
    return (this.turned(now - SPAN, now) * 1000) / SPAN;
  }

  /** Angle between the views of two times, in degrees. */
  turned(from: number, to: number): number {
    return angleBetween(this.#at(from), this.#at(to));
  }

  #at(now: number) {
    const at = this.#start + now;
    return poseAt(this.#points, at - this.#duration * Math.floor(at / this.#duration)).quaternion;
  }
}
