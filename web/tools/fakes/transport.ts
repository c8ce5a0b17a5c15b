/** A transport for tests: requests wait until the test answers them. */
import { deferred } from "#client/async/deferred";
import type { FrameReply, FrameTransport, TransportKind } from "#client/transport/transport";
import type { FrameHeader, RenderRequest, ServerTiming, VideoInfo } from "#client/wire/render";

export interface FakeRequest {
  readonly request: RenderRequest;
  readonly signal: AbortSignal;
  readonly sentAt: number;
  /** Answers with a frame that ends now and started `transmission` milliseconds ago. */
  reply(options?: {
    readonly timing?: ServerTiming;
    readonly bytes?: number;
    readonly requestsPerS?: number;
    readonly transmission?: number;
  }): void;
  fail(error: unknown): void;
}

interface FakeOptions {
  readonly kind?: TransportKind;
  readonly maxInFlight?: number;
  readonly overtaking?: boolean;
}

export class FakeTransport implements FrameTransport {
  readonly kind: TransportKind;
  readonly maxInFlight: number;
  readonly overtaking: boolean;
  readonly lost: Promise<string>;
  readonly lose: (reason: string) => void;
  readonly requests: FakeRequest[] = [];
  closed = false;
  readonly #now: () => number;
  /** The last frame of the video. */
  #encoded: number | null = null;

  constructor(now: () => number, { kind = "fetch", maxInFlight = 32, overtaking = true }: FakeOptions = {}) {
    this.#now = now;
    this.kind = kind;
    this.maxInFlight = maxInFlight;
    this.overtaking = overtaking;
    const { promise, resolve } = deferred<string>();
    this.lost = promise;
    this.lose = resolve;
  }

  request(request: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    const { promise, resolve, reject } = deferred<FrameReply>();
    const sentAt = this.#now();
    signal.addEventListener("abort", () => reject(signal.reason), { once: true });
    this.requests.push({
      request,
      signal,
      sentAt,
      fail: reject,
      reply: ({ timing = { queue: 0, render: 0, encode: 0 }, bytes = 1000, requestsPerS, transmission = 0 } = {}) => {
        const at = this.#now();
        const header = {
          status: 200,
          seq: request.seq ?? 0,
          content_type: "image/jpeg",
          timing,
          ...extent(request),
          requests_per_s: requestsPerS ?? null,
          video: this.#videoInfo(request),
        };
        const arrival = {
          sentAt,
          firstByteAt: at - transmission,
          lastByteAt: at,
          bytes,
          sharedBytes: transmission > 0 ? bytes : 0,
        };
        const bitmap = { width: 1280, height: 720, close: () => undefined } as ImageBitmap;
        resolve({ header, image: new Blob(), arrival, picture: Promise.resolve({ bitmap, depth: null }) });
      },
    });
    return promise;
  }

  close(): void {
    this.closed = true;
  }

  /** Answers like a server that encodes the frames of a video in the order of its answers. */
  #videoInfo({ video, seq = 0 }: RenderRequest): VideoInfo | null {
    if (!video) return null;
    const key = video.key === true || this.#encoded === null;
    const after = key ? null : this.#encoded;
    this.#encoded = seq;
    return { key, after, codec: "avc1.42c01f" };
  }
}

/** The header of a frame with margins. Rungs are as large as the viewport. */
function extent({ width, height, overscan = 0, profile = null }: RenderRequest): Partial<FrameHeader> {
  if (overscan === 0) return { width, height, profile };
  const margin_x = Math.round(width * overscan);
  const margin_y = Math.round(height * overscan);
  return { width: width + 2 * margin_x, height: height + 2 * margin_y, margin_x, margin_y, profile };
}

/** Lets all promises that can settle now settle. */
export async function settle(): Promise<void> {
  for (let i = 0; i < 20; i++) await Promise.resolve();
}

const later = globalThis.setTimeout;

/** Lets streams and lazily loaded parts of the page proceed; works with fake timers. */
export function turn(): Promise<void> {
  return new Promise((resolve) => later(resolve, 0));
}
