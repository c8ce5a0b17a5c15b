/**
 * Maps frames to the segments of low-latency video, for controllers published for segments.
 *
 * A segment is a frame: the bitrate of a rung is a frame's bytes times the requests per second. The published constants
 * assume a target latency of 1.5 s and segments of half a second; here the target is 100 ms, which is the same on a
 * clock that runs 15 times as fast. All times are therefore multiplied by 15, and every published constant stays
 * unchanged, the length of a segment included. Sweeps try other targets (docs/results/2026-11-seen.md).
 *
 * The remaining share of the target, after a frame's response beyond the recent minimum, stands in for the buffer. A
 * player's buffer does not know the distance to the server either: it fills and drains by the delay of a segment
 * relative to earlier ones. Measured from zero, a round trip of 100 ms would leave the buffer empty forever.
 */
import { type Observation, responseTime } from "./controller";
import { RecentMinimum } from "./link-delay";
import type { FrameSizes } from "./sizes";

/** The published target latency, in seconds. */
export const TARGET_LATENCY = 1.5;
/** Its counterpart here, in milliseconds. */
export const TARGET_MS = 100;
/** The published length of a segment, in seconds. */
export const SEGMENT = 0.5;
/** dash.js trusts this much of the measured throughput. */
export const SAFETY = 0.9;
/** Window of the minimum response, in milliseconds. */
const LEAST_SPAN = 10_000;

/** Requests per second of the page: one for each animation frame of a usual display. */
const REQUEST_RATE = 60;

/** The bitrates of all rungs, in bits per second of our own clock, the lowest first. */
export function bitrates(sizes: FrameSizes, rungs: number): number[] {
  return Array.from({ length: rungs }, (_, i) => sizes.expected(rungs - 1 - i) * 8 * REQUEST_RATE);
}

/** A frame's response time, in seconds of the published clock; `target`: the target latency, in milliseconds. */
export function latencyOf(observation: Pick<Observation, "arrival">, target: number): number {
  return (responseTime(observation) * TARGET_LATENCY) / target;
}

export class FrameBuffer {
  readonly #least = new RecentMinimum(LEAST_SPAN);
  readonly #target: number;

  /** `target`: the target latency, in milliseconds. */
  constructor(target: number) {
    this.#target = target;
  }

  /** Remaining target latency after a frame, in seconds of the published clock; at least 0. */
  level(observation: Pick<Observation, "arrival" | "at">): number {
    const latency = latencyOf(observation, this.#target);
    return Math.max(0, TARGET_LATENCY - (latency - this.#least.add(latency, observation.at)));
  }
}
