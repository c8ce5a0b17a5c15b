/**
 * LoL+ (Bentaleb, Akcay, Lim, Begen, Zimmermann: "Catching the moment with LoL+ in Twitch-like low-latency live
 * streaming platforms", IEEE Transactions on Multimedia 2021): a self-organising map with a neuron per bitrate. It
 * chooses the neuron nearest to the goal (all of the throughput, no latency, no rebuffering, no switch), with weights
 * that promise the highest QoE. The neuron in use learns from measurements, the chosen one from the goal. The constants
 * are from the authors' contribution to dash.js. segments.ts maps frames to segments. There is no playback speed to
 * control.
 */
import type { Controller, ControllerContext, Observation } from "./controller";
import { bestWeights, downloadTime, nextBuffer } from "./lolp-qoe";
import { distance, type Features, firstWeights, SelfOrganisingMap } from "./lolp-som";
import { bitrates, FrameBuffer, latencyOf, SAFETY, TARGET_MS } from "./segments";
import { FrameSizes } from "./sizes";

export interface LolpParameters {
  /** Target latency, in milliseconds. */
  readonly target: number;
  /** Share of the throughput that is trusted. */
  readonly safety: number;
  /** A buffer below this many seconds is low. */
  readonly minBuffer: number;
  /** How far the map moves towards a sample. */
  readonly learningRate: number;
}

/** The authors' values. */
export const LOLP: LolpParameters = { target: TARGET_MS, safety: SAFETY, minBuffer: 0.3, learningRate: 0.01 };

/** Latency is divided by this to be a feature. */
const LATENCY_NORM = 100;
/** A bitrate must be this much below the throughput, in bits per second. */
const THROUGHPUT_DELTA = 10_000;
/** Weight of the throughput for bitrates that the link or the buffer does not carry. */
const DISCOURAGED = 100;

export class LolpController implements Controller {
  readonly #sizes: FrameSizes;
  readonly #count: number;
  readonly #map: SelfOrganisingMap;
  readonly #parameters: LolpParameters;
  readonly #buffer: FrameBuffer;
  #weights: Features;
  /** Index of the bitrate in use, 0 the lowest. */
  #current = 0;

  constructor({ ladder, random }: ControllerContext, parameters = LOLP) {
    this.#parameters = parameters;
    this.#buffer = new FrameBuffer(parameters.target);
    this.#sizes = new FrameSizes(ladder);
    this.#count = ladder.length;
    const rates = bitrates(this.#sizes, this.#count);
    const features = rates.map((rate) => rate / norm(rates));
    this.#map = new SelfOrganisingMap(features, parameters.learningRate);
    this.#weights = firstWeights(this.#count, Math.max(...features), random);
  }

  decide(): number {
    return this.#count - 1 - this.#current;
  }

  /** Learned neurons, that of the lowest bitrate first, and the weights of the features. */
  get learned(): { readonly neurons: readonly Features[]; readonly weights: Features } {
    return { neurons: this.#map.neurons, weights: this.#weights };
  }

  observe(observation: Observation): void {
    this.#sizes.observe(observation.profile, observation.arrival.bytes);
    const buffer = this.#buffer.level(observation);
    if (observation.throughput === null) return;
    const { safety, minBuffer, target: targetMs } = this.#parameters;
    const throughput = safety * observation.throughput;
    const latency = latencyOf(observation, targetMs);
    const rates = bitrates(this.#sizes, this.#count);
    const download = downloadTime(rates[this.#current] ?? 0, throughput);
    if (buffer - download < minBuffer) {
      this.#shiftDown(rates, throughput);
      return;
    }
    this.#weights = this.#chooseWeights(rates, throughput, buffer) ?? this.#weights;
    const target = this.#target(rates, throughput);
    const winner = this.#winner(rates, throughput, buffer, target);
    const change = Math.abs((rates[this.#current] ?? 0) - (rates[winner] ?? 0)) / norm(rates);
    const rebuffering = Math.max(0, download - buffer);
    this.#map.learn(this.#current, [target, latency / LATENCY_NORM, rebuffering, change]);
    this.#map.learn(winner, [target, 0, 0, change]);
    this.#current = winner;
  }

  /** The buffer is low: the highest bitrate below the current one that fits the link, if any. */
  #shiftDown(rates: readonly number[], throughput: number): void {
    const lower = rates.slice(0, this.#current).findLastIndex((rate) => rate < throughput);
    if (lower >= 0) this.#current = lower;
  }

  #chooseWeights(rates: readonly number[], throughput: number, buffer: number): Features | null {
    const latencies = this.#map.neurons.map(([, learned]) => learned);
    const { minBuffer } = this.#parameters;
    return bestWeights({ rates, latencies, throughput, buffer, minBuffer });
  }

  /** The throughput as a feature: more than all bitrates together is as much as the highest neuron has. */
  #target(rates: readonly number[], throughput: number): number {
    const normalised = throughput / norm(rates);
    return normalised > 1 ? Math.max(...this.#map.neurons.map(([learned]) => learned)) : normalised;
  }

  #winner(rates: readonly number[], throughput: number, buffer: number, target: number): number {
    const distances = this.#map.neurons.map((neuron, i) => {
      const rate = rates[i] ?? 0;
      const low = nextBuffer(buffer, downloadTime(rate, throughput)) < this.#parameters.minBuffer;
      const tooMuch = i > 0 && (low || rate > throughput - THROUGHPUT_DELTA);
      const [, ...others] = this.#weights;
      const weights: Features = tooMuch ? [DISCOURAGED, ...others] : this.#weights;
      return distance(neuron, [target, 0, 0, 0], weights);
    });
    return distances.indexOf(Math.min(...distances));
  }
}

/** Divides bitrates to make features of them: where all frames are larger or smaller than expected, features stay the same. */
function norm(rates: readonly number[]): number {
  return Math.hypot(...rates);
}
