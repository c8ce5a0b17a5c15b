/**
 * Our own controller with reprojection, *View*: the least error of what is seen over the next second, against what should be
 * seen. With every animation frame the page turns the newest frame to the view, so a late picture is no late answer, only one
 * that has been turned further. It takes the rung that costs least (least-cost.ts):
 *
 *     cost(ℓ) = MSE(rung ℓ) + MSE(ω · age(ℓ))
 *     age(ℓ) = trip + server(ℓ) + link(ℓ) + interval(ℓ)
 *
 * `ω` is how fast the camera turns, `age` that of the pixels, for which `interval` counts whole: half of it is how long they have
 * been on the screen on the mean, and half how long they may wait for the frame before. `view-error.ts` has both errors. The round
 * trip counts: the error of age grows faster than age does, so time is dearer where there is much of it already. And it is cheap
 * where the camera hardly moves.
 */
import type { ControllerContext, Observation } from "./controller";
import { type FrameTimes, LeastCostController } from "./least-cost";
import { ageError, rungError, type Way } from "./view-error";

/** Another rung must have so much less error, as a share of the present one's. */
const BETTER = 0.1;
/** The speed that is expected is the average of so many milliseconds: it remembers a turn for longer than a rest. */
const RISE = 1500;
const FALL = 3000;
/** A longer pause between frames is a rest, which says nothing of how fast the camera will turn (ms). */
const PAUSE = 250;
/** Whoever rests will move again: the least speed that is expected, in degrees a second. */
const LEAST_SPEED = 10;

export class ViewController extends LeastCostController {
  readonly #pictures: readonly number[];
  #speed = LEAST_SPEED;
  #way: Way = "stale";
  #heardAt: number | undefined;

  constructor({ ladder }: Pick<ControllerContext, "ladder">) {
    super(ladder);
    this.#pictures = ladder.map(rungError);
  }

  override observe(observation: Observation): void {
    const { turning, way, at } = observation;
    const elapsed = Math.min(PAUSE, at - (this.#heardAt ?? at));
    this.#heardAt = at;
    this.#speed += (1 - Math.exp(-elapsed / (turning > this.#speed ? RISE : FALL))) * (turning - this.#speed);
    this.#way = way;
    super.observe(observation);
  }

  protected cost(rung: number, { server, link, interval, trip }: FrameTimes): number {
    const age = trip + server + link + interval;
    const degrees = (Math.max(LEAST_SPEED, this.#speed) * age) / 1000;
    return (this.#pictures[rung] ?? 0) + ageError(this.#way, degrees);
  }

  protected less(cost: number): number {
    return cost * (1 - BETTER);
  }
}
