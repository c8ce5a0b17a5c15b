/** Reassembles frames from datagrams that may be lost, duplicated, reordered or forged. */

/** seq (4 bytes), fragment (2), fragments (2), all unsigned and big-endian. */
export const FRAGMENT_HEADER_BYTES = 8;

type Bytes = Uint8Array<ArrayBuffer>;

interface Partial {
  readonly count: number;
  readonly fragments: Map<number, Bytes>;
}

export interface WholeFrame {
  readonly seq: number;
  readonly chunks: Bytes[];
}

export class Reassembler {
  readonly #wanted: (seq: number) => boolean;
  readonly #frames = new Map<number, Partial>();

  /** Only `wanted` frames take memory, so a sender cannot make us hold more than we requested. */
  constructor(wanted: (seq: number) => boolean) {
    this.#wanted = wanted;
  }

  /** Takes one datagram and returns the frame that it completes, if any. Invalid datagrams are ignored. */
  add(datagram: Bytes): WholeFrame | undefined {
    if (datagram.byteLength <= FRAGMENT_HEADER_BYTES) return undefined;
    const view = new DataView(datagram.buffer, datagram.byteOffset);
    const [seq, index, count] = [view.getUint32(0), view.getUint16(4), view.getUint16(6)];
    if (index >= count || !this.#wanted(seq)) return undefined;
    const frame = this.#frames.get(seq) ?? { count, fragments: new Map() };
    if (frame.count !== count || frame.fragments.has(index)) return undefined;
    this.#frames.set(seq, frame);
    frame.fragments.set(index, datagram.subarray(FRAGMENT_HEADER_BYTES));
    if (frame.fragments.size < count) return undefined;
    this.#frames.delete(seq);
    return { seq, chunks: Array.from({ length: count }, (_, i) => frame.fragments.get(i) as Bytes) };
  }

  drop(seq: number): void {
    this.#frames.delete(seq);
  }

  get partial(): number {
    return this.#frames.size;
  }
}
