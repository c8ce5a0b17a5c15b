/**
 * How fast the link delivers. A live stream comes as fast as it is made, so that a segment's bytes by its time tell of the
 * stream; a chunk is sent at once, so that its own bytes by their own time tell of the link. One that is there at once took no time
 * that can be measured: such a link is faster than anything that is offered.
 */
import { TimeWindow } from "../view/window";

/** How far back it looks, in milliseconds. */
const SPAN = 1500;
const HEADER = 8;
/** ISO/IEC 14496-12: the box that ends a chunk, as a number. */
const MDAT = 0x6d646174;

export class DeliveryRate {
  /** Bits a second of each chunk. */
  readonly #rates = new TimeWindow(SPAN);
  /** The present box's header, as far as it has come. */
  #header: number[] = [];
  /** What is still to come of the present box. */
  #left = 0;
  #type = 0;
  /** The present chunk: when its first bytes came, and how many came later. */
  #chunk: { readonly since: number; later: number } | undefined;

  /** A segment begins. */
  begin(): void {
    this.#header = [];
    this.#left = 0;
    this.#chunk = undefined;
  }

  /** The next bytes of the segment came. */
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

  /** Bits a second, half of the last chunks came faster; infinite if they came at once, null if there were none. */
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

/** What a representation may have of the measured rate. */
const SHARE = 0.8;

/** The best whose bitrate fits well into the rate; the lowest while the rate is unknown. Lowest first. */
export function affordable<T extends { readonly bandwidth: number }>(
  offered: readonly [T, ...T[]],
  rate: number | null,
): T {
  return offered.findLast(({ bandwidth }) => bandwidth <= SHARE * (rate ?? 0)) ?? offered[0];
}
