/**
 * LoL+'s quality of experience of a segment, and its choice of the weights of the map's features by it. Constants are those
 * of the authors' contribution to dash.js. Bitrates in bits per second, times in seconds.
 */
import { SEGMENT } from "./segments";

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

/** How long a segment of a bitrate takes. */
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
