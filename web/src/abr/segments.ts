/**
 * Frames as the segments of low-latency video, for controllers that were published for those.
 *
 * A segment is a frame interval: the bitrate of a rung is a frame's bytes over the interval. The published constants are for a
 * target latency of 1.5 s and segments of half a second; here the target is 100 ms and the interval 33 ms, which is the same
 * but for a clock that runs 15 times as fast. So all times are multiplied by 15, and every published constant holds as it is.
 *
 * What plays the part of the buffer is how much of the target is left of a frame's response beyond the least response lately.
 * A player's buffer does not know how far the server is, either: it fills and drains by how much later a segment comes than
 * those before it. Measured from zero, a round trip of 100 ms would leave an empty buffer for ever.
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
/** The least response is that of so many milliseconds. */
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

  /** What a frame leaves of the target latency, in seconds of the published clock; never less than nothing. */
  level(observation: Pick<Observation, "arrival" | "at">): number {
    const least = this.#least.add(latencyOf(observation), observation.at);
    return Math.max(0, TARGET_LATENCY - (latencyOf(observation) - least));
  }
}
