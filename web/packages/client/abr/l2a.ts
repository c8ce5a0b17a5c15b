/**
 * L2A-LL, "Learn to adapt" (Karagkioules, Mekuria, Griffioen, Wagenaar: "Online learning for low-latency adaptive
 * streaming", MMSys 2020): online convex optimisation over a probability distribution w of the bitrates. Each segment
 * takes one step of gradient descent on the Lagrangian, whose multiplier Q tracks the deviation of the buffer from its
 * target, and projects w back on the simplex; the bitrate nearest to the expectation under w is chosen. The constants
 * and the four refinements (start-up by throughput, a sign for bitrates above the link's capacity, one step up at a
 * time, a new Q after an overestimate) are from the authors' contribution to dash.js. segments.ts maps frames to
 * segments.
 */
import type { Controller, ControllerContext, Observation } from "./controller";
import { bitrates, FrameBuffer, SAFETY, SEGMENT, TARGET_MS } from "./segments";
import { FrameSizes } from "./sizes";

/**
 * The point of the probability simplex {x : x ≥ 0, Σx = 1} that is nearest to a point in the Euclidean sense:
 * x = max(y − t, 0) with t such that the sum is 1 (Chen and Ye, "Projection Onto A Simplex", arXiv:1101.6081).
 */
export function projectToSimplex(point: readonly number[]): number[] {
  let sum = 0;
  let threshold = 0;
  for (const [i, value] of point.toSorted((a, b) => b - a).entries()) {
    const candidate = (sum + value - 1) / (i + 1);
    if (candidate >= value) break;
    sum += value;
    threshold = candidate;
  }
  return point.map((value) => Math.max(value - threshold, 0));
}

export interface L2aParameters {
  /** Number of segments to converge. */
  readonly horizon: number;
  /** How strongly Q reacts to an overestimate. */
  readonly react: number;
  /** Target latency, in milliseconds. */
  readonly target: number;
}

/** The authors' values. */
export const L2A: L2aParameters = { horizon: 4, react: 2, target: TARGET_MS };

/** Upper bound of Q. Doubled without limit, it would overflow for good after a thousand frames too large for the link. */
const MAX_Q = 1e6;
/** A shorter reception measures the clock rather than the link, in milliseconds. */
const MIN_DURATION = 2;

/** The state after a step; bitrates ascend. */
export interface LearnerState {
  readonly w: readonly number[];
  readonly q: number;
  readonly choice: number;
}

/** Cautiousness, VL in the paper. */
function cautiousness({ horizon }: L2aParameters): number {
  return horizon ** 0.99;
}

/** The state at the end of start-up. */
export function initialState(count: number, choice: number, parameters = L2A): LearnerState {
  return { w: Array.from({ length: count }, (_, i) => (i === choice ? 1 : 0)), q: cautiousness(parameters), choice };
}

/** One segment: the learned state, all bitrates (ascending) and the last segment's throughput, in the same unit. */
export function step(
  before: LearnerState,
  rates: readonly number[],
  throughput: number,
  parameters = L2A,
): LearnerState {
  const vl = cautiousness(parameters);
  const { horizon, react } = parameters;
  const stepSize = Math.max(horizon, vl * Math.sqrt(horizon));
  const load = rates.map((rate) => rate / throughput);
  const gain = (SEGMENT / (2 * stepSize)) * (before.q + vl);
  const w = projectToSimplex(before.w.map((p, i) => p + (at(load, i) > 1 ? -1 : 1) * gain * at(load, i)));
  const change = w.map((p, i) => p - at(before.w, i));
  const q = Math.max(0, before.q - SEGMENT + SEGMENT * (dot(load, w) + dot(load, change)));
  const expected = dot(rates, w);
  let choice = nearest(rates, expected);
  if (choice > before.choice && at(load, before.choice + 1) <= 1) choice = before.choice + 1;
  return { w, q: Math.min(MAX_Q, at(load, choice) >= 1 ? react * Math.max(vl, q) : q), choice };
}

export class L2aController implements Controller {
  readonly #sizes: FrameSizes;
  readonly #count: number;
  readonly #parameters: L2aParameters;
  readonly #buffer: FrameBuffer;
  #state: LearnerState | undefined;
  #choice = 0;

  constructor({ ladder }: Pick<ControllerContext, "ladder">, parameters = L2A) {
    this.#parameters = parameters;
    this.#buffer = new FrameBuffer(parameters.target);
    this.#sizes = new FrameSizes(ladder);
    this.#count = ladder.length;
  }

  decide(): number {
    return this.#count - 1 - this.#choice;
  }

  /** Undefined during start-up. */
  get learned(): LearnerState | undefined {
    return this.#state;
  }

  observe(observation: Observation): void {
    const { profile, arrival, throughput } = observation;
    this.#sizes.observe(profile, arrival.bytes);
    const buffer = this.#buffer.level(observation);
    if (throughput === null) return;
    const rates = bitrates(this.#sizes, this.#count);
    if (this.#state === undefined) {
      this.#choice = Math.max(
        0,
        rates.findLastIndex((rate) => rate <= SAFETY * throughput),
      );
      if (buffer > 0) this.#state = initialState(this.#count, this.#choice, this.#parameters);
      return;
    }
    this.#state = step(this.#state, rates, lastThroughput(observation) ?? throughput, this.#parameters);
    this.#choice = this.#state.choice;
  }
}

/** Throughput of this frame alone, in bits per second; null if it arrived too fast to measure. */
function lastThroughput({ arrival }: Observation): number | null {
  const duration = arrival.lastByteAt - arrival.firstByteAt;
  return duration < MIN_DURATION || arrival.sharedBytes === 0 ? null : (arrival.sharedBytes * 8000) / duration;
}

function at(values: readonly number[], i: number): number {
  return values[i] ?? 0;
}

function dot(a: readonly number[], b: readonly number[]): number {
  return a.reduce((sum, value, i) => sum + value * at(b, i), 0);
}

function nearest(values: readonly number[], expected: number): number {
  return values.reduce(
    (best, value, i) => (Math.abs(value - expected) < Math.abs(at(values, best) - expected) ? i : best),
    0,
  );
}
