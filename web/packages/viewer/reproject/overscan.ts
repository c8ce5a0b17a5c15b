/**
 * Auto overscan: the margin of the next frame at each side, so that it still covers the views that it will be warped
 * to. It is the recently needed margin, scaled by the ratio of the present to the past camera speed:
 *
 *     overscan = P(needed) · ω / P(ω)
 *
 * `P` is the 70th percentile over the last two seconds of movement and ω the camera's speed; ω / P(ω) is clamped to 1/4
 * to 2. Latency and prediction need no model: pictures rendered for exactly the displayed views needed little. At rest
 * it is 0. Pure: time is an argument.
 */
import { angleBetween, conjugate, multiply, rotate, subtract, type Vector3 } from "../view/vector";
import { nearestRank } from "../view/window";
import type { View } from "./view";

export const MAX_OVERSCAN = 0.25;
/** Granularity of margins, so that few frames differ in size. */
const STEP = 0.025;
/** Milliseconds of movement that are kept. */
const SPAN = 2000;
const RANK = 0.7;
const SLOWEST = 0.25;
const FASTEST = 2;
/** Slower rotation, in degrees per second, is the camera's tremor. */
const LEAST_SPEED = 10;
/** Weight of the newest speed in the average. */
const ALPHA = 0.4;
/** Tolerance in degrees when orientations are compared. */
const ROUNDING = 1e-6;
/** A camera without movement for this many milliseconds rests; longer gaps between samples are ignored. */
const REST = 200;
/** A view that turns further from one sample to the next is a cut, in degrees. */
const CUT = 30;
const DEGREES = 180 / Math.PI;
/** Percentiles are kept for this long, in milliseconds: over two seconds they hardly change sooner. */
const KEPT_FOR = 100;

interface Sample {
  readonly needed: number;
  readonly speed: number;
  /** Milliseconds since the previous sample. */
  readonly elapsed: number;
}

export class AutoOverscan {
  readonly #distance: number;
  /** Samples while the camera moved, newest last. */
  #samples: Sample[] = [];
  /** Their total duration, in milliseconds. */
  #span = 0;
  #last: { readonly view: View; readonly at: number } | undefined;
  #speed = 0;
  #movedAt = Number.NEGATIVE_INFINITY;
  #usual = { at: Number.NEGATIVE_INFINITY, needed: 0, speed: 0 };

  /** `distance` is how far away most of the scene is, in its units. */
  constructor(distance = Number.POSITIVE_INFINITY) {
    this.#distance = distance;
  }

  /** Once per animation frame: a picture that was rendered for `frame` was shown turned to `view`; both without margins. */
  observe(frame: View, view: View, now: number): void {
    const last = this.#last;
    this.#last = { view, at: now };
    if (last === undefined || now <= last.at) return;
    const elapsed = now - last.at;
    const moved = angleBetween(last.view.quaternion, view.quaternion) + this.#parallax(last.view, view);
    if (elapsed > REST || moved > CUT) return;
    const needed = neededMargin(frame, view, this.#distance);
    this.#speed += ALPHA * ((moved * 1000) / elapsed - this.#speed);
    if (moved > ROUNDING) this.#movedAt = now;
    if (now - this.#movedAt <= REST) this.#remember({ needed, speed: this.#speed, elapsed });
  }

  /** The share of the viewport's width and height to request at each side, 0 to MAX_OVERSCAN. */
  at(now: number): number {
    if (now - this.#movedAt > REST) return 0;
    if (now - this.#usual.at >= KEPT_FOR) {
      this.#usual = { at: now, needed: this.#percentile("needed"), speed: this.#percentile("speed") };
    }
    const { needed, speed } = this.#usual;
    const faster = Math.min(FASTEST, Math.max(SLOWEST, this.#speed / Math.max(LEAST_SPEED, speed)));
    const exact = needed * faster;
    return Math.min(MAX_OVERSCAN, STEP * Math.max(0, Math.ceil(exact / STEP - 1e-6)));
  }

  /** How far things appear to turn because the camera moved, in degrees. */
  #parallax(from: View, to: View): number {
    return DEGREES * Math.atan(Math.hypot(...subtract(to.position, from.position)) / this.#distance);
  }

  #remember(sample: Sample): void {
    this.#samples.push(sample);
    this.#span += sample.elapsed;
    while (this.#span > SPAN) this.#span -= this.#samples.shift()?.elapsed ?? this.#span;
  }

  #percentile(name: "needed" | "speed"): number {
    const values = this.#samples.map((sample) => sample[name]);
    return nearestRank(values, RANK) ?? 0;
  }
}

/**
 * How far `view` reaches beyond the viewport of `frame`, as a share of that viewport's width or height: at the middles of its
 * sides, because corners that stick out are small. Infinite if it looks elsewhere.
 */
export function neededMargin(frame: View, view: View, distance = Number.POSITIVE_INFINITY): number {
  const back = conjugate(frame.quaternion);
  const turned = multiply(back, view.quaternion);
  const moved = rotate(back, subtract(view.position, frame.position)).map((value) => value / distance);
  const { width, height } = view;
  const middles = [
    [0, height / 2],
    [width, height / 2],
    [width / 2, 0],
    [width / 2, height],
  ] as const;
  const margins = middles.map(([column, row]) => {
    const ray: Vector3 = [(column - view.cx) / view.fx, (row - view.cy) / view.fy, 1];
    const [x = 0, y = 0, z = 0] = rotate(turned, ray).map((value, i) => value + (moved[i] ?? 0));
    if (z <= 0) return Number.POSITIVE_INFINITY;
    const across = (frame.cx + (frame.fx * x) / z) / frame.width;
    const down = (frame.cy + (frame.fy * y) / z) / frame.height;
    return Math.max(-across, across - 1, -down, down - 1);
  });
  return Math.max(0, ...margins);
}
