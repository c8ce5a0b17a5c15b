/** The browser's statistics of a video received over RTP, polled. */

/** Numbers a video's frames by their RTP timestamps, which count 90,000 per second and wrap around after 2³²: 13 hours. */
const RATE = 90_000;

export class RtpFrames {
  readonly #ticks: number;
  /** The newest timestamp seen, and the number of its frame. */
  #newest: { readonly timestamp: number; readonly frame: number } | null = null;

  constructor(frameRate: number) {
    this.#ticks = RATE / frameRate;
  }

  /** The number of the frame with this timestamp; the first one gets an arbitrary number. */
  number(timestamp: number): number {
    const newest = this.#newest ?? { timestamp, frame: 0 };
    const ahead = (timestamp - newest.timestamp) | 0; // modulo 2³², between -2³¹ and 2³¹
    const frame = newest.frame + Math.round(ahead / this.#ticks);
    if (ahead >= 0) this.#newest = { timestamp, frame };
    return frame;
  }
}

export interface ReceiverStats {
  /** All bytes of the video's packets so far, including headers. */
  readonly bytes: number;
  /** Mean time of recent frames in the jitter buffer in milliseconds; null before the first. */
  readonly jitterBuffer: number | null;
  /** Packets lost so far. */
  readonly lost: number;
}

/** The fields used of the standard's RTCInboundRtpStreamStats. */
interface Inbound {
  readonly type: string;
  readonly kind?: string;
  readonly bytesReceived?: number;
  readonly headerBytesReceived?: number;
  readonly jitterBufferDelay?: number;
  readonly jitterBufferEmittedCount?: number;
  readonly packetsLost?: number;
}

export class StatsReader {
  #delay = 0;
  #emitted = 0;
  #jitterBuffer: number | null = null;

  /** Reads a report of `RTCPeerConnection.getStats`; null while it contains no video. */
  read(report: Iterable<readonly [string, Inbound]>): ReceiverStats | null {
    const inbound = [...report].map(([, stats]) => stats).find(isVideo);
    if (inbound === undefined) return null;
    const { bytesReceived = 0, headerBytesReceived = 0, packetsLost = 0 } = inbound;
    const { jitterBufferDelay = 0, jitterBufferEmittedCount = 0 } = inbound;
    const emitted = jitterBufferEmittedCount - this.#emitted;
    if (emitted > 0) this.#jitterBuffer = ((jitterBufferDelay - this.#delay) / emitted) * 1000;
    this.#delay = jitterBufferDelay;
    this.#emitted = jitterBufferEmittedCount;
    return { bytes: bytesReceived + headerBytesReceived, jitterBuffer: this.#jitterBuffer, lost: packetsLost };
  }
}

function isVideo({ type, kind }: Inbound): boolean {
  return type === "inbound-rtp" && kind === "video";
}
