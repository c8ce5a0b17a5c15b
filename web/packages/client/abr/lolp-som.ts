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
 * The first weights, before there is anything to choose them by: centres are spread over count² random points as k-means++
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
