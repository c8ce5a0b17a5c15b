/**
 * Our own controller without reprojection, *Budget*: a frame may take WORTH longer for each doubling of its bytes. It takes the
 * rung that costs least (least-cost.ts):
 *
 *     cost(ℓ) = server(ℓ) + link(ℓ) + interval(ℓ) + WORTH · log₂(E(0) / E(ℓ))
 *
 * `E` is what the ladder expects of a rung's bytes. The interval counts because what is longer than an animation frame makes the
 * next ones wait. What is alike for all rungs, such as the round trip, decides nothing: a better picture costs as much near the
 * server as far from it.
 */
import type { ControllerContext } from "./controller";
import { type FrameTimes, LeastCostController } from "./least-cost";

/** Milliseconds that a picture of twice the bytes is worth. */
const WORTH = 10;
/** Another rung must cost so much less, in milliseconds. */
const BETTER = 3;

export class BudgetController extends LeastCostController {
  /** What the rungs' pictures cost, in milliseconds. */
  readonly #pictures: readonly number[];

  constructor({ ladder }: Pick<ControllerContext, "ladder">) {
    super(ladder);
    const best = ladder[0]?.expected_kb ?? 1;
    this.#pictures = ladder.map(({ expected_kb }) => WORTH * Math.log2(best / expected_kb));
  }

  protected cost(rung: number, { server, link, interval }: FrameTimes): number {
    return server + link + interval + (this.#pictures[rung] ?? 0);
  }

  protected less(cost: number): number {
    return cost - BETTER;
  }
}
