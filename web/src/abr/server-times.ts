/**
 * How long the server takes for a frame of each rung: the moving average of its own frames, if any came lately. One that was not
 * seen is on the straight line, over the number of pixels, through the two nearest ones that were; with one, it takes as long.
 */
import type { Rung, ServerTiming } from "../wire/render";

/** Milliseconds a frame. */
export interface ServerTime {
  /** All of it, waiting included. */
  readonly total: number;
  /** The slowest stage: no more frames than one in so long can come. */
  readonly stage: number;
}

/** Weight of the newest frame. */
const ALPHA = 0.2;
/** What was not seen for so many milliseconds is forgotten: the server, or the view, may have changed. */
const FORGOTTEN = 15_000;
const UNKNOWN: ServerTime = { total: 0, stage: 0 };

export class ServerTimes {
  readonly #pixels: readonly number[];
  readonly #seen: ({ readonly time: ServerTime; readonly at: number } | undefined)[];

  constructor(ladder: readonly Rung[]) {
    this.#pixels = ladder.map(({ width, height }) => width * height);
    this.#seen = ladder.map(() => undefined);
  }

  observe(rung: number | null, timing: ServerTiming | null, at: number): void {
    if (rung === null || rung >= this.#seen.length || timing === null) return;
    for (const [i, seen] of this.#seen.entries()) {
      if (seen !== undefined && seen.at < at - FORGOTTEN) this.#seen[i] = undefined;
    }
    const { queue, render, encode } = timing;
    const newest = { total: queue + render + encode, stage: Math.max(render, encode) };
    const average = this.#seen[rung]?.time ?? newest;
    const mixed = (key: keyof ServerTime) => average[key] + ALPHA * (newest[key] - average[key]);
    this.#seen[rung] = { time: { total: mixed("total"), stage: mixed("stage") }, at };
  }

  /** Of a frame of that rung. */
  expected(rung: number): ServerTime {
    const own = this.#seen[rung]?.time;
    if (own !== undefined) return own;
    const pixels = this.#pixels[rung] ?? 0;
    const away = (other: { readonly pixels: number }) => Math.abs(other.pixels - pixels);
    const [near, far] = this.#seen
      .flatMap((seen, i) => (seen === undefined ? [] : [{ time: seen.time, pixels: this.#pixels[i] ?? 0 }]))
      .toSorted((a, b) => away(a) - away(b));
    if (near === undefined) return UNKNOWN;
    if (far === undefined || far.pixels === near.pixels) return near.time;
    const along = (pixels - near.pixels) / (far.pixels - near.pixels);
    const line = (key: keyof ServerTime) => Math.max(0, near.time[key] + along * (far.time[key] - near.time[key]));
    return { total: line("total"), stage: line("stage") };
  }
}
