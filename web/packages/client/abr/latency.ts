/**
 * The paper's controller, *Latency*: the completion time of a frame of rung ℓ is T(ℓ) = S(ℓ) / r, with S(ℓ) the rung's
 * expected size and r the throughput. One rung up if the next one's T is at most T_TARGET; one rung down if the current
 * one's T is above T_MARGIN; either only when HOLD frames in a row agree, except that a fast turn goes down at once.
 *
 * The paper leaves Δt in r = S / Δt open: it is "the download duration" of a request whose "start/end times" are
 * recorded. Both readings are implemented. *Per request* is literal, from the request to the last byte, and includes
 * round trip, server and waiting; *per transfer* is from the first to the last byte and measures only the link.
 */
import { type Controller, type ControllerContext, type Observation, responseTime } from "./controller";
import { FrameSizes } from "./sizes";
import { RecentAverage } from "./throughput";

/** The longest completion time at which it goes up, in milliseconds; from the paper. */
const T_TARGET = 100;
/** The completion time above which it goes down, in milliseconds; the paper only says that it exceeds T_TARGET. */
const T_MARGIN = 120;
/** Frames in a row that must agree; from the paper. */
const HOLD = 3;
/** A faster turn is rapid panning, in degrees per second; the paper gives no number. */
export const RAPID_PANNING = 90;

/** Observes every frame and returns the throughput in bits per second, or null while it is unknown. */
export type ThroughputReading = (observation: Observation) => number | null;

/** A frame's own bytes over the time from its request to its last byte, averaged over the last five. */
export function perRequest(): ThroughputReading {
  const average = new RecentAverage();
  return (observation) => {
    const duration = responseTime(observation);
    if (duration > 0 && observation.arrival.bytes > 0) average.add((observation.arrival.bytes * 8000) / duration);
    return average.value;
  };
}

/** Bytes received by all requests between a frame's first and last byte: the page's own estimate (throughput.ts). */
export function perTransfer(): ThroughputReading {
  return ({ throughput }) => throughput;
}

export class LatencyController implements Controller {
  readonly #throughput: ThroughputReading;
  readonly #sizes: FrameSizes;
  readonly #lowest: number;
  readonly #target: number;
  readonly #margin: number;
  #rung: number;
  /** The change that the last frames agree on: -1 to a better rung, 1 to a worse one. */
  #wanted: -1 | 0 | 1 = 0;
  #agreeing = 0;

  /** `target` replaces T_TARGET, in milliseconds, for comparisons at equal quality; T_MARGIN scales with it. */
  constructor({ ladder }: Pick<ControllerContext, "ladder">, throughput: ThroughputReading, target: number = T_TARGET) {
    this.#throughput = throughput;
    this.#sizes = new FrameSizes(ladder);
    this.#lowest = ladder.length - 1;
    this.#rung = this.#lowest;
    this.#target = target;
    this.#margin = (target * T_MARGIN) / T_TARGET;
  }

  decide(): number {
    return this.#rung;
  }

  observe(observation: Observation): void {
    this.#sizes.observe(observation.profile, observation.arrival.bytes);
    const throughput = this.#throughput(observation);
    if (throughput === null) return;
    const wanted = this.#wants(throughput);
    this.#agreeing = wanted === this.#wanted ? this.#agreeing + 1 : 1;
    this.#wanted = wanted;
    const atOnce = wanted === 1 && observation.turning > RAPID_PANNING;
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
