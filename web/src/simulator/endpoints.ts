/**
 * Both ends of the network as the simulator needs them: how long the server and the page take for a frame, how large frames
 * are, when the page draws, and how the camera turns. Here those of the paper; `measured.ts` has those of a real visit.
 */

import { normal, seeded } from "../abr/random";
import type { Rung } from "../wire/render";
import { Motion } from "./motion";

export interface Endpoints {
  /** The server's milliseconds to render a frame of a rung, and to encode it. */
  render(rung: number): number;
  encode(rung: number): number;
  /** Bytes of a frame of a rung at a time; times never go back. */
  bytes(rung: number, now: number): number;
  /** When the page hears of a packet that arrives now. */
  heard(now: number): number;
  /** The page's milliseconds to decode a frame of a rung. */
  decode(rung: number): number;
  /** When the page's animation frame after `now` comes. */
  nextAnimationFrame(now: number): number;
  /** Degrees a second at a time; times never go back. */
  turning(now: number): number;
}

export const ANIMATION_FRAME = 1000 / 60;
/** The paper's server, an RTX 2060 Super: rasterising takes 11 ms, encoding the best rung up to 1 ms. */
export const PAPER_RENDER = 11;
const ENCODE = 1;
/** A frame takes this much more or less to render, at most. */
const RENDER_VARIATION = 0.15;
const DECODE = 4;
/** How much a frame's size varies with the view (standard deviation), and for how long a view stays alike (ms). */
const SIZE_DEVIATION = 0.12;
const SIZE_MEMORY = 2000;

export interface PaperOptions {
  /** Milliseconds to render a frame of no pixels, and one of the best rung; those between by their pixels. Alike if not said. */
  readonly render?: number;
  readonly renderBest?: number;
  /** Frames are so many times as large as the ladder says. */
  readonly scale?: number;
  /** The page hears of what has arrived every so many milliseconds; 0: of each packet at once. */
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

  /** Its pixels, as a share of the best rung's. */
  #sizeOf(rung: number): number {
    const [own, best] = [this.#ladder[rung], this.#ladder[0]];
    return own && best ? (own.width * own.height) / (best.width * best.height) : 1;
  }

  /** The ladder's size times how rich in detail the view is: a Gaussian process that wanders as views do. */
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
