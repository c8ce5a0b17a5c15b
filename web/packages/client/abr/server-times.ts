/**
 * Server time for a frame of each rung: the moving average of recent frames with the same number of pixels, at any JPEG
 * quality. Sizes without recent frames are interpolated over the number of pixels between the two nearest sizes, or
 * copied from the only one.
 *
 * A busy machine, or a view with more Gaussians, slows all sizes alike, so each new frame scales the estimates of all
 * sizes. Otherwise a size abandoned in a slow moment would keep that moment's estimate.
 */
import type { Rung, ServerTiming } from "../wire/render";

/** Milliseconds per frame. */
export interface ServerTime {
  /** Total time, including waiting. */
  readonly total: number;
  /** Time in the slowest stage, which bounds the frame rate. */
  readonly stage: number;
}

/**
 * Weight of the newest frame; the first frames count equally and together estimate the size's time relative to the
 * others.
 */
const ALPHA = 0.2;
const FIRST = 1 / ALPHA;
/** Measurements older than this many milliseconds are dropped: the server, or the view, may have changed. */
const FORGOTTEN = 15_000;
const UNKNOWN: ServerTime = { total: 0, stage: 0 };

interface Seen {
  readonly pixels: number;
  total: number;
  stage: number;
  frames: number;
  at: number;
}

export class ServerTimes {
  readonly #pixels: readonly number[];
  /** By number of pixels. */
  readonly #seen = new Map<number, Seen>();

  constructor(ladder: readonly Rung[]) {
    this.#pixels = ladder.map(({ width, height }) => width * height);
  }

  observe(rung: number | null, timing: ServerTiming | null, at: number): void {
    const pixels = rung === null ? undefined : this.#pixels[rung];
    if (pixels === undefined || timing === null) return;
    for (const [size, seen] of this.#seen) if (seen.at < at - FORGOTTEN) this.#seen.delete(size);
    const { queue, render, encode } = timing;
    const newest = { total: queue + render + encode, stage: Math.max(render, encode) };
    const own = this.#seen.get(pixels) ?? { ...newest, pixels, frames: 0, at };
    own.frames++;
    const weight = Math.max(ALPHA, 1 / own.frames);
    const total = own.total + weight * (newest.total - own.total);
    const stage = own.stage + weight * (newest.stage - own.stage);
    const slower = own.frames > FIRST && own.stage > 0 ? stage / own.stage : 1;
    for (const each of this.#seen.values()) {
      each.total *= slower;
      each.stage *= slower;
    }
    this.#seen.set(pixels, Object.assign(own, { total, stage, at }));
  }

  expected(rung: number): ServerTime {
    const pixels = this.#pixels[rung] ?? 0;
    const own = this.#seen.get(pixels);
    if (own !== undefined) return own;
    const away = (other: Seen) => Math.abs(other.pixels - pixels);
    const [near, far] = [...this.#seen.values()].sort((a, b) => away(a) - away(b));
    if (near === undefined) return UNKNOWN;
    if (far === undefined) return near;
    const along = (pixels - near.pixels) / (far.pixels - near.pixels);
    const line = (key: keyof ServerTime) => Math.max(0, near[key] + along * (far[key] - near[key]));
    return { total: line("total"), stage: line("stage") };
  }
}
