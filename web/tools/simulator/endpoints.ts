/**
 * Both ends of the simulated network: frame times of the server and the page, frame sizes, animation frames, and the
 * rotation of the camera. The defaults are the paper's.
 */

import { normal, seeded } from "#client/abr/random";
import type { Rung } from "#client/wire/render";
import { Motion } from "./motion";

export interface Endpoints {
  /** The server's milliseconds to render a frame of a rung, and to encode it. */
  render(rung: number): number;
  encode(rung: number): number;
  /** Bytes of a frame of a rung at a time; times never decrease. */
  bytes(rung: number, now: number): number;
  /** Time at which the page sees a packet that arrives now. */
  heard(now: number): number;
  /** The page's milliseconds to decode a frame of a rung. */
  decode(rung: number): number;
  /** Time of the page's first animation frame after `now`. */
  nextAnimationFrame(now: number): number;
  /** Turning speed at a time, in degrees per second; times never decrease. */
  turning(now: number): number;
}

export const ANIMATION_FRAME = 1000 / 60;
/** The paper's server, an RTX 2060 Super: rasterising takes 11 ms, encoding the best rung up to 1 ms. */
const PAPER_RENDER = 11;
const ENCODE = 1;
/** Largest relative deviation of a frame's rendering time. */
const RENDER_VARIATION = 0.15;
const DECODE = 4;
/** Standard deviation of a frame's size across views, and the correlation time of a view (ms). */
const SIZE_DEVIATION = 0.12;
const SIZE_MEMORY = 2000;

export interface PaperOptions {
  /**
   * Milliseconds to render an empty frame, and one of the best rung; linear in pixels between them. Constant by
   * default.
   */
  readonly render?: number;
  readonly renderBest?: number;
  /** Factor on the frame sizes of the ladder. */
  readonly scale?: number;
  /** Interval in milliseconds at which the page sees arrived packets; 0: each packet at once. */
  readonly batch?: number;
}

export class PaperEndpoints implements Endpoints {
  readonly #ladder: readonly Rung[];
  readonly #random: () => number;
  readonly #motion: Motion;
  readonly #render: { readonly least: number; readonly best: number };
  readonly #scale: number;
  readonly #batch: number;
  #richness = 0;
  #richnessAt = 0;

  constructor(ladder: readonly Rung[], seed: number, options: PaperOptions = {}) {
    const { render = PAPER_RENDER, renderBest = render, scale = 1, batch = 0 } = options;
    this.#ladder = ladder;
    this.#random = seeded(seed);
    this.#motion = new Motion(seeded(seed + 1));
    this.#render = { least: render, best: renderBest };
    this.#scale = scale;
    this.#batch = batch;
  }

  render(rung: number): number {
    const { least, best } = this.#render;
    const mean = least + (best - least) * this.#sizeOf(rung);
    return mean * (1 + RENDER_VARIATION * (2 * this.#random() - 1));
  }

  encode(rung: number): number {
    return ENCODE * this.#sizeOf(rung);
  }

  /** A rung's pixels, as a share of the best rung's. */
  #sizeOf(rung: number): number {
    const [own, best] = [this.#ladder[rung], this.#ladder[0]];
    return own && best ? (own.width * own.height) / (best.width * best.height) : 1;
  }

  /** The ladder's size times the view's richness in detail, a Gaussian process that drifts as views do. */
  bytes(rung: number, now: number): number {
    const kept = Math.exp((this.#richnessAt - now) / SIZE_MEMORY);
    this.#richness = kept * this.#richness + Math.sqrt(1 - kept ** 2) * normal(this.#random);
    this.#richnessAt = now;
    const expected = (this.#ladder[rung]?.expected_kb ?? 0) * 1000 * this.#scale;
    return Math.round(expected * Math.max(0.5, 1 + SIZE_DEVIATION * this.#richness));
  }

  heard(now: number): number {
    return this.#batch === 0 ? now : this.#batch * Math.ceil(now / this.#batch);
  }

  decode(): number {
    return DECODE;
  }

  nextAnimationFrame(now: number): number {
    return now + ANIMATION_FRAME;
  }

  turning(now: number): number {
    return this.#motion.speed(now);
  }
}
