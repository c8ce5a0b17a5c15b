/**
 * LoL+ (Bentaleb, Akcay, Lim, Begen, Zimmermann: "Catching the moment with LoL+ in Twitch-like low-latency live
 * streaming platforms", IEEE Transactions on Multimedia 2021): a self-organising map with a neuron per bitrate. It
 * chooses the neuron nearest to the goal (all of the throughput, no latency, no rebuffering, no switch), with weights
 * that promise the highest QoE. The neuron in use learns from measurements, the chosen one from the goal. The constants
 * are from the authors' contribution to dash.js. segments.ts maps frames to segments. There is no playback speed to
 * control.
 */
import type { Controller, ControllerContext, Observation } from "./controller";
import { bitrates, FrameBuffer, latencyOf, SAFETY, SEGMENT, TARGET_MS } from "./segments";
import { FrameSizes } from "./sizes";

/**
 * LoL+'s self-organising map: one neuron per bitrate, with four features (throughput, latency, rebuffering, switch). A
 * neuron and its neighbours are drawn towards each sample with a learning rate and a Gaussian neighbourhood of width
 * 0.1.
 */
export type Features = readonly [number, number, number, number];

const NEIGHBOURHOOD = 0.1;
const EQUAL: Features = [1, 1, 1, 1];

export function distance(a: Features, b: Features, weights: Features = EQUAL): number {
  return Math.sqrt(weights.reduce((sum, weight, i) => sum + weight * ((a[i] ?? 0) - (b[i] ?? 0)) ** 2, 0));
}

export class SelfOrganisingMap {
  readonly #neurons: Features[];
  readonly #learningRate: number;

  /** `throughputs`: the neurons' bitrates, normalised. */
  constructor(throughputs: readonly number[], learningRate: number) {
    this.#learningRate = learningRate;
    this.#neurons = throughputs.map((throughput): Features => [throughput, 0, 0, 0]);
  }

  get neurons(): readonly Features[] {
    return this.#neurons;
  }

  /**
   * Draws a neuron and its neighbours to a point, one after the other as in dash.js, so that later neighbours see the
   * neuron's new position.
   */
  learn(neuron: number, point: Features): void {
    for (const [i, features] of this.#neurons.entries()) {
      const centre = this.#neurons[neuron] ?? features;
      const rate = this.#learningRate * Math.exp(-(distance(features, centre) ** 2) / (2 * NEIGHBOURHOOD ** 2));
      const [t, l, r, s] = features;
      this.#neurons[i] = [
        t + rate * (point[0] - t),
        l + rate * (point[1] - l),
        r + rate * (point[2] - r),
        s + rate * (point[3] - s),
      ];
    }
  }
}

/**
 * The initial weights, with nothing to choose them by yet: centres are spread over count² random points as k-means++
 * spreads them (each the point farthest from those before), the least similar comes first, the others by their distance from
 * it, and the last is taken.
 */
export function firstWeights(count: number, maxThroughput: number, random: () => number): Features {
  const points = Array.from(
    { length: Math.max(1, count ** 2) },
    (): Features => [random() * maxThroughput, random(), random(), random()],
  );
  const centres = points.slice(0, 1);
  while (centres.length < count) {
    const gap = (point: Features) => Math.min(...centres.map((centre) => distance(point, centre)));
    centres.push(points.reduce((best, point) => (gap(point) > gap(best) ? point : best)));
  }
  const apart = (point: Features) => centres.reduce((sum, centre) => sum + distance(point, centre), 0);
  const first = centres.reduce((best, centre) => (apart(centre) > apart(best) ? centre : best));
  return centres.reduce((best, centre) => (distance(first, centre) > distance(first, best) ? centre : best));
}

/*
 * LoL+'s quality of experience of a segment, and its choice of the weights of the map's features by it. Constants are those
 * of the authors' contribution to dash.js. Bitrates in bits per second, times in seconds.
 */

/** Latencies up to this are penalised mildly. */
const COMFORTABLE_LATENCY = 1.1;
const OPTIONS = [0.2, 0.4, 0.6, 0.8, 1];
const LEAST_REBUFFERING = 1e-5;

export type Weights = readonly [number, number, number, number];

/**
 * The QoE of one segment: reward for its bitrate, less penalties for rebuffering and latency. As in dash.js the reward counts
 * in bit/s and the penalties in kbit/s, so that a thousandth of their published weight is left.
 */
export function qoe(bitrate: number, rebuffering: number, latency: number, rates: readonly number[]): number {
  const [lowest, highest] = [Math.min(...rates) / 1000, Math.max(...rates) / 1000];
  const latencyPenalty = latency <= COMFORTABLE_LATENCY ? 0.05 * lowest : 0.1 * highest;
  return SEGMENT * bitrate - highest * rebuffering - latencyPenalty * latency;
}

/** How long a segment of a bitrate takes to download. */
export function downloadTime(bitrate: number, throughput: number): number {
  return (bitrate * SEGMENT) / throughput;
}

export function nextBuffer(buffer: number, download: number): number {
  return download > SEGMENT ? buffer - SEGMENT : buffer + SEGMENT - download;
}

export interface WeightSearch {
  readonly rates: readonly number[];
  /** The map's learned latency of each rate. */
  readonly latencies: readonly number[];
  readonly throughput: number;
  readonly buffer: number;
  /** A buffer below this is low. */
  readonly minBuffer: number;
}

/**
 * The weights with which some neuron promises the highest QoE; null if all leave the buffer low. dash.js lacks the
 * published bound of the latency, the target plus its change, and takes each latency for a change from zero. The
 * published search goes through all 5⁴ vectors; its QoE depends on two of the four weights, and the first best wins, so
 * the other two are always the first option.
 */
export function bestWeights(question: WeightSearch): Weights | null {
  const { rates, latencies, throughput, buffer, minBuffer } = question;
  let best: Weights | null = null;
  let highest = Number.NEGATIVE_INFINITY;
  for (const [i, rate] of rates.entries()) {
    const download = downloadTime(rate, throughput);
    const next = nextBuffer(buffer, download);
    if (next < minBuffer) continue;
    const rebuffering = Math.max(LEAST_REBUFFERING, download - next);
    for (const forLatency of OPTIONS) {
      for (const forBuffer of OPTIONS) {
        const value = qoe(rate, (1 / forBuffer) * rebuffering, (1 / forLatency) * (latencies[i] ?? 0), rates);
        if (value > highest) {
          highest = value;
          best = [0.2, forLatency, forBuffer, 0.2];
        }
      }
    }
  }
  return best;
}

export interface LolpParameters {
  /** Target latency, in milliseconds. */
  readonly target: number;
  /** Trusted share of the throughput. */
  readonly safety: number;
  /** A buffer below this many seconds is low. */
  readonly minBuffer: number;
  /** How far the map moves towards a sample. */
  readonly learningRate: number;
}

/** The authors' values. */
export const LOLP: LolpParameters = { target: TARGET_MS, safety: SAFETY, minBuffer: 0.3, learningRate: 0.01 };

/** Divides latency to make a feature of it. */
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

  /** The throughput as a feature; if it exceeds the norm of all bitrates, the feature of the highest neuron. */
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

/** Divides bitrates to make features of them, which stay the same if all frames are larger or smaller than expected. */
function norm(rates: readonly number[]): number {
  return Math.hypot(...rates);
}
