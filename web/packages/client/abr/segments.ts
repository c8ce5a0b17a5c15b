/**
 * Maps frames to the segments of low-latency video, for controllers published for segments.
 *
 * A segment is a frame interval: the bitrate of a rung is a frame's bytes over the interval. The published constants
 * assume a target latency of 1.5 s and segments of half a second; here the target is 100 ms and the interval 33 ms,
 * which is the same on a clock that runs 15 times as fast. All times are therefore multiplied by 15, and every
 * published constant stays unchanged.
 *
 * The remaining share of the target, after a frame's response beyond the recent minimum, stands in for the buffer. A
 * player's buffer does not know the distance to the server either: it fills and drains by the delay of a segment
 * relative to earlier ones. Measured from zero, a round trip of 100 ms would leave the buffer empty forever.
 */
import { type Observation, responseTime } from "./controller";
import { RecentMinimum } from "./recent-minimum";
import type { FrameSizes } from "./sizes";

/** Seconds of the published clock in a millisecond of ours: 1.5 s are 100 ms. */
const SECONDS_PER_MS = 0.015;
/** The published target latency, in seconds: 100 ms here. */
export const TARGET_LATENCY = 1.5;
/** A frame interval at 30 frames a second, in seconds of the published clock. */
export const SEGMENT = (1000 / 30) * SECONDS_PER_MS;
/** dash.js trusts this much of the measured throughput. */
export const SAFETY = 0.9;
/** Window of the minimum response, in milliseconds. */
const LEAST_SPAN = 10_000;

/** The bitrates of all rungs, in bits per second of our own clock, the lowest first. */
export function bitrates(sizes: FrameSizes, rungs: number): number[] {
  return Array.from({ length: rungs }, (_, i) => sizes.expected(rungs - 1 - i) * 8 * 30);
}

/** A frame's response time, in seconds of the published clock. */
export function latencyOf(observation: Pick<Observation, "arrival">): number {
  return responseTime(observation) * SECONDS_PER_MS;
}

export class FrameBuffer {
  readonly #least = new RecentMinimum(LEAST_SPAN);

  /** Remaining target latency after a frame, in seconds of the published clock; at least 0. */
  level(observation: Pick<Observation, "arrival" | "at">): number {
    const least = this.#least.add(latencyOf(observation), observation.at);
    return Math.max(0, TARGET_LATENCY - (latencyOf(observation) - least));
  }
}
