/** Chooses the profile of each frame. Pure: time is part of each observation, randomness part of the context. */
import type { Arrival } from "../transport/transport";
import type { Rung, ServerTiming } from "../wire/render";

/** No adaptation: always the rung that the user chose. */
export class FixedController implements Controller {
  readonly #rung: number;

  constructor(rung: number) {
    this.#rung = rung;
  }

  decide(): number {
    return this.#rung;
  }

  observe(): void {}
}

/**
 * How the page shows a frame older than the view: unchanged, rotated, warped by its depth, or rendered for a predicted
 * pose.
 */
export const WAYS = ["stale", "rotation", "depth", "predicted"] as const;
export type Way = (typeof WAYS)[number];

export interface Observation {
  /** The rung at which it was rendered; null if the server does not report it. */
  readonly profile: number | null;
  /** Times of its request and its bytes, and their number. */
  readonly arrival: Arrival;
  /** Breakdown of the server's time, in milliseconds; null if the server does not report it. */
  readonly server: ServerTiming | null;
  /** The link's throughput in bits per second (ThroughputEstimator), or null while unknown. */
  readonly throughput: number | null;
  /** Number of other requests in flight. */
  readonly inFlight: number;
  /** How fast the camera turns, in degrees per second. */
  readonly turning: number;
  /** How the page shows a frame that is older than the view. */
  readonly way: Way;
  /** Time of the observation on the page's clock, in milliseconds. */
  readonly at: number;
}

export interface Controller {
  /**
   * The ladder's rung for the next frame; 0 is the best. Called once per animation frame with its time `now` on the
   * page's clock in milliseconds; the answer is not binding.
   */
  decide(now: number): number;
  /** Called once per received frame, in order of arrival. */
  observe(observation: Observation): void;
}

export interface ControllerContext {
  /** The server's rungs, the best first; at least one. */
  readonly ladder: readonly Rung[];
  /** Uniform in [0, 1). */
  readonly random: () => number;
}

export type ControllerFactory = (context: ControllerContext) => Controller;

/** From sending a request to its frame's last byte, in milliseconds. */
export function responseTime({ arrival }: Pick<Observation, "arrival">): number {
  return arrival.lastByteAt - arrival.sentAt;
}

/** Total time of a frame in the server, in milliseconds; 0 if it is unknown. */
export function serverTime({ server }: Pick<Observation, "server">): number {
  return server === null ? 0 : server.queue + server.render + server.encode;
}
