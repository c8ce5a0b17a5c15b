/** Interface of all ways to fetch frames. */
import type { FrameHeader, Problem, RenderRequest } from "../wire/render";

/** A decoded picture, and the coarse depth that it may carry. */
export interface DepthMap {
  readonly width: number;
  readonly height: number;
  /** The inverse depth of code 255, in 1/scene units. */
  readonly nearest: number;
  /**
   * Row by row, over the whole frame with its margins; the centre of column i is at (i + 0.5) / width. The inverse
   * depth (1/z, not along the ray) is nearest · code / 255; 0 is infinitely far.
   */
  readonly codes: Uint8Array<ArrayBuffer>;
}

export interface DecodedImage {
  readonly bitmap: ImageBitmap;
  /** Depth of the whole frame; null if it has none. */
  readonly depth: DepthMap | null;
}

export type TransportKind = "webtransport-streams" | "webtransport-datagrams" | "fetch";

/** Reception times and bytes of a reply, in milliseconds on the page's clock. */
export interface Arrival {
  readonly sentAt: number;
  readonly firstByteAt: number;
  readonly lastByteAt: number;
  /** Bytes of this reply. */
  readonly bytes: number;
  /** Bytes of all replies of the transport received after this reply's first packet, until `lastByteAt`. */
  readonly sharedBytes: number;
}

export interface FrameReply {
  readonly header: FrameHeader;
  readonly image: Blob;
  readonly arrival: Arrival;
  /** The decoded image; absent for frames of a video, and before a frame worker has seen it. Its recipient closes it. */
  readonly picture?: Promise<DecodedImage>;
}

export interface FrameTransport {
  readonly kind: TransportKind;
  /** The most requests that it can carry at once. */
  readonly maxInFlight: number;
  /**
   * The server attributes all requests to one viewer and renders the newest first. An outdated request then costs next
   * to nothing, and it pays to send every view.
   */
  readonly overtaking: boolean;
  /** Settles with a reason once the server can no longer be reached through it; never rejects. */
  readonly lost: Promise<string>;
  /**
   * Fetches one frame. Rejects with RequestProblem if the server refuses, FrameDropped if the frame will not come, the
   * signal's reason if it was aborted, and anything else if the connection failed.
   */
  request(request: RenderRequest, signal: AbortSignal): Promise<FrameReply>;
  close(): void;
}

/** The server refused a request and gave a reason. */
export class RequestProblem extends Error {
  readonly problem: Problem;

  constructor(problem: Problem) {
    super(problem.detail);
    this.name = "RequestProblem";
    this.problem = problem;
  }
}

/** A frame got lost on its way, or a newer one overtook it. */
export class FrameDropped extends Error {
  constructor(reason: string) {
    super(reason);
    this.name = "FrameDropped";
  }
}
