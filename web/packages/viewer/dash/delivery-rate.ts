/**
 * Delivery rate of the link. A live stream arrives at the rate of its encoder, so bytes over time of a segment measure
 * the stream; a chunk is sent at once, so its bytes over its time measure the link. The time of a chunk that arrives in
 * one piece cannot be measured: such a link is faster than any representation.
 */
import { TimeWindow } from "../view/window";

/** How far back it looks, in milliseconds. */
const SPAN = 1500;
const HEADER = 8;
/** ISO/IEC 14496-12: the box that ends a chunk, as a number. */
const MDAT = 0x6d646174;

export class DeliveryRate {
  /** Bits per second of each chunk. */
  readonly #rates = new TimeWindow(SPAN);
  /** Received part of the current box's header. */
  #header: number[] = [];
  /** Missing bytes of the current box. */
  #left = 0;
  #type = 0;
  /** The current chunk: the time of its first bytes, and the number of later ones. */
  #chunk: { readonly since: number; later: number } | undefined;

  begin(): void {
    this.#header = [];
    this.#left = 0;
    this.#chunk = undefined;
  }

  received(bytes: Uint8Array, at: number): void {
    for (let next = 0; next < bytes.length; ) {
      this.#chunk ??= { since: at, later: 0 };
      const before = next;
      if (this.#left === 0) {
        this.#header.push(bytes[next++] ?? 0);
        if (this.#header.length === HEADER) this.#open();
      } else {
        const here = Math.min(this.#left, bytes.length - next);
        next += here;
        this.#left -= here;
      }
      if (at > this.#chunk.since) this.#chunk.later += next - before;
      if (this.#left === 0 && this.#header.length === 0 && this.#type === MDAT) this.#close(at);
    }
  }

  /** Median bits per second of the last chunks; infinite if they arrived in one piece, null without any. */
  bitsPerSecond(now: number): number | null {
    return this.#rates.percentile(0.5, now);
  }

  #open(): void {
    const number = (from: number) => this.#header.slice(from, from + 4).reduce((sum, byte) => sum * 256 + byte, 0);
    this.#left = Math.max(0, number(0) - HEADER);
    this.#type = number(4);
    this.#header = [];
  }

  #close(at: number): void {
    const { since, later } = this.#chunk ?? { since: at, later: 0 };
    this.#rates.add(at > since ? (later * 8000) / (at - since) : Number.POSITIVE_INFINITY, at);
    this.#chunk = undefined;
    this.#type = 0;
  }
}

/** Share of the measured rate that a representation may use. */
const SHARE = 0.8;

/**
 * The best representation whose bitrate fits the rate with a margin; the lowest while the rate is unknown. Lowest
 * first.
 */
export function affordable<T extends { readonly bandwidth: number }>(
  offered: readonly [T, ...T[]],
  rate: number | null,
): T {
  return offered.findLast(({ bandwidth }) => bandwidth <= SHARE * (rate ?? 0)) ?? offered[0];
}
