/**
 * The paper's controller, *Latency*: the completion time of a frame of rung ℓ is T(ℓ) = S(ℓ) / throughput, with S(ℓ) the
 * rung's expected size. One rung up if the next one's T is at most T_TARGET; one rung down if the current one's T is above
 * T_MARGIN; either only when HOLD frames in a row agree, except that a fast turn goes down at once.
 *
 * T counts the bytes' time on the link alone, as published: neither round trip nor server nor queue.
 */
import type { Controller, ControllerContext, Observation } from "./controller";
import { FrameSizes } from "./sizes";

/** The longest completion time to go up to, in milliseconds; from the paper. */
const T_TARGET = 100;
/** Above this it goes down, in milliseconds; the paper says only that it is more than T_TARGET. */
const T_MARGIN = 120;
/** Frames in a row that must agree; from the paper. */
const HOLD = 3;
/** A faster turn is rapid panning, in degrees a second; the paper gives no number. */
export const RAPID_PANNING = 90;

export class LatencyController implements Controller {
  readonly #sizes: FrameSizes;
  readonly #lowest: number;
  readonly #target: number;
  readonly #margin: number;
  #rung: number;
  /** The change that the last frames agree on: -1 to a better rung, 1 to a lesser one. */
  #wanted: -1 | 0 | 1 = 0;
  #agreeing = 0;

  /** `target` in milliseconds: another T_TARGET, for comparisons at equal quality; T_MARGIN keeps its proportion. */
  constructor({ ladder }: Pick<ControllerContext, "ladder">, target: number = T_TARGET) {
    this.#sizes = new FrameSizes(ladder);
    this.#lowest = ladder.length - 1;
    this.#rung = this.#lowest;
    this.#target = target;
    this.#margin = (target * T_MARGIN) / T_TARGET;
  }

  decide(): number {
    return this.#rung;
  }

  observe({ profile, arrival, throughput, turning }: Observation): void {
    this.#sizes.observe(profile, arrival.bytes);
    if (throughput === null) return;
    const wanted = this.#wants(throughput);
    this.#agreeing = wanted === this.#wanted ? this.#agreeing + 1 : 1;
    this.#wanted = wanted;
    const atOnce = wanted === 1 && turning > RAPID_PANNING;
    if (wanted === 0 || (this.#agreeing < HOLD && !atOnce)) return;
    this.#rung += wanted;
    this.#wanted = 0;
  }

  #wants(throughput: number): -1 | 0 | 1 {
    const completion = (rung: number) => (this.#sizes.expected(rung) * 8000) / throughput;
    if (this.#rung < this.#lowest && completion(this.#rung) > this.#margin) return 1;
    if (this.#rung > 0 && completion(this.#rung - 1) <= this.#target) return -1;
    return 0;
  }
}
