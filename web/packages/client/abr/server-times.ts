/**
 * Server time for a frame of each rung: the moving average of recent frames with the same number of pixels, at any JPEG
 * quality. Sizes without recent frames are interpolated over the number of pixels between the two nearest sizes, or
 * copied from the only one.
 *
 * A busy machine, or a view with more Gaussians, slows all sizes alike, so each new frame scales the estimates of all
 * sizes. Otherwise a size abandoned in a slow moment would keep that moment's estimate.
 */
import type { Rung, ServerTiming } from "../wire/render";

/** Milliseconds a frame. */
export interface ServerTime {
  /** All of it, waiting included. */
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
  readonly time: ServerTime;
  readonly frames: number;
  readonly at: number;
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
    const { time: average, frames: before } = this.#seen.get(pixels) ?? { time: newest, frames: 0 };
    const frames = before + 1;
    const weight = Math.max(ALPHA, 1 / frames);
    const mixed = (key: keyof ServerTime) => average[key] + weight * (newest[key] - average[key]);
    const time = { total: mixed("total"), stage: mixed("stage") };
    if (frames > FIRST && average.stage > 0) this.#slow(time.stage / average.stage);
    this.#seen.set(pixels, { time, frames, at });
  }

  /** Multiplies the times of all sizes. */
  #slow(times: number): void {
    for (const [size, { time, ...seen }] of this.#seen) {
      this.#seen.set(size, { ...seen, time: { total: times * time.total, stage: times * time.stage } });
    }
  }

  expected(rung: number): ServerTime {
    const pixels = this.#pixels[rung] ?? 0;
    const own = this.#seen.get(pixels)?.time;
    if (own !== undefined) return own;
    const away = (other: { readonly pixels: number }) => Math.abs(other.pixels - pixels);
    const [near, far] = [...this.#seen]
      .map(([size, { time }]) => ({ time, pixels: size }))
      .toSorted((a, b) => away(a) - away(b));
    if (near === undefined) return UNKNOWN;
    if (far === undefined) return near.time;
    const along = (pixels - near.pixels) / (far.pixels - near.pixels);
    const line = (key: keyof ServerTime) => Math.max(0, near.time[key] + along * (far.time[key] - near.time[key]));
    return { total: line("total"), stage: line("stage") };
  }
}
