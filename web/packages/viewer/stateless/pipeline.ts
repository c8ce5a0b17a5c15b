/**
 * Keeps frames of the newest view coming, at any round trip.
 *
 * `want` is called once per animation frame with the newest view and never waits. A changed view is a new version; a
 * request goes out if the newest version is neither on screen nor in flight and the limit allows it. At the limit, the
 * newest view waits in its slot and older ones are dropped. A failed request is repeated while its view is the newest,
 * so the last view is always rendered. Showing a frame cancels all older requests.
 *
 * The pipeline keeps to the request rate announced by a busy server (in-flight-limit.ts).
 *
 * A request without a rung refines a resting view (refinement.ts). It may be large, so it is cancelled as soon as
 * another view is wanted, is left out of the statistics, and is not repeated if it fails.
 */
import { FrameClock } from "#client/abr/frame-clock";
import {
  type DecodedImage,
  FrameDropped,
  type FrameReply,
  type FrameTransport,
  RequestProblem,
} from "#client/transport/transport";
import type { FrameHeader, RenderRequest } from "#client/wire/render";
import type { Request } from "#client/wire/store";
import { InFlightLimit, RequestPace } from "./in-flight-limit";
import type { PictureFormat } from "./picture-format";

/** A request without its number. */
export type ViewRequest = Omit<RenderRequest, "seq">;

/** A request in flight; its state changes until it is `shown` or has failed. */
export interface SentRequest {
  /** Time of the request on the page's clock. */
  readonly at: number;
  readonly pose: number;
  /** The rung; null for a refinement. */
  readonly asked: number | null;
  /** `overtaken` from its last byte until its frame is handed to the screen. */
  readonly fate: Request["fate"];
}

type Mutable<T> = { -readonly [K in keyof T]: T[K] };

export interface DecodedFrame extends DecodedImage {
  readonly seq: number;
  /** The version of the view that it shows. */
  readonly version: number;
  readonly pose: number;
  readonly header: FrameHeader;
  /** The request and the received image: only a reference, invalid once the frame has been shown. */
  readonly asked: ViewRequest & { readonly seq: number };
  readonly image: Blob;
  /** Time of the request on the page's clock. */
  readonly askedAt: number;
}

export interface PipelineEvents {
  sent(request: SentRequest): void;
  /** Called when a frame for pose number `pose` has arrived; it may still be decoding. */
  replied(reply: FrameReply, view: ViewRequest, pose: number): void;
  /** Called with a refusal to show to the user; late frames are excluded. */
  refused(problem: RequestProblem): void;
  unrefined(): void;
  format(): PictureFormat;
  /** Transmission time of this many bytes in milliseconds, 0 if unknown. */
  transmission(bytes: number): number;
}

export interface PipelineCounts {
  readonly sent: number;
  /** Requests overtaken by a newer frame, on our side. */
  readonly cancelled: number;
  /** Frames overtaken or late on the server's side, or lost on the way. */
  readonly dropped: number;
}

/** Decodes the picture of a frame. Rejects with the signal's reason if aborted. */
export type Decode = (reply: FrameReply, signal: AbortSignal) => Promise<DecodedImage>;

interface Entry {
  readonly version: number;
  readonly request: Mutable<SentRequest>;
  readonly abort: AbortController;
}

/** A picture requested independently of the view. The recipient closes its bitmap. */
export interface AsidePicture extends DecodedImage, FrameReply {}

type ReadyFrame = DecodedFrame & Pick<Entry, "request">;

/** Milliseconds before a failed view is requested again. */
const RETRY_AFTER = 150;
/** Problems of a single late frame: counted and not shown. */
const LATE = new Set(["tigas:superseded", "tigas:deadline-exceeded"]);
/** Not shown: the next frame announces the request rate. */
const TOO_OFTEN = "tigas:asked-too-often";

export class FramePipeline {
  readonly #transport: FrameTransport;
  readonly #decode: Decode;
  readonly #now: () => number;
  readonly #events: PipelineEvents;
  readonly #clock = new FrameClock();
  readonly #limit: InFlightLimit;
  readonly #pace = new RequestPace();
  readonly #inFlight = new Map<number, Entry>();
  readonly #asides = new Set<AbortController>();
  #seq = 0;
  #version = 0;
  #wanted: ViewRequest | undefined;
  #shown: Pick<DecodedFrame, "seq" | "version"> = { seq: -1, version: 0 };
  #ready: ReadyFrame | undefined;
  #retryAt = Number.NEGATIVE_INFINITY;
  #counts = { sent: 0, cancelled: 0, dropped: 0 };

  constructor(transport: FrameTransport, decode: Decode, now: () => number, events: PipelineEvents) {
    this.#transport = transport;
    this.#limit = new InFlightLimit(transport.overtaking, this.#clock);
    this.#decode = decode;
    this.#now = now;
    this.#events = events;
  }

  /** Takes the newest view, of pose number `pose`, and requests it if there is room. */
  want(view: ViewRequest, pose: number): void {
    const now = this.#now();
    this.#clock.tick(now);
    if (this.#wanted === undefined || !sameView(view, this.#wanted)) {
      this.#wanted = view;
      this.#version++;
      this.#cancel(({ request }) => request.asked === null, "another view is wanted");
    }
    const covered = Math.max(this.#shown.version, this.#ready?.version ?? 0, ...this.#versionsInFlight());
    const may = now >= this.#retryAt && this.#pace.allows(now);
    if (covered < this.#version && this.#room > 0 && may) void this.#send(view, pose);
  }

  /** Whether an additional request fits without delaying the view. */
  get spare(): boolean {
    // With datagrams, the first complete frame would push out the older ones.
    if (this.#transport.kind === "webtransport-datagrams" && this.#inFlight.size > 0) return false;
    return this.#room > this.#asides.size && this.#pace.allows(this.#now());
  }

  /**
   * Requests a picture independently of the view; neither replaces the other. Rejects like the transport and the
   * decoder.
   */
  async aside(request: ViewRequest): Promise<AsidePicture> {
    const abort = new AbortController();
    this.#asides.add(abort);
    this.#pace.sent(this.#now());
    try {
      const reply = await this.#transport.request(this.#asked(request, this.#seq++), abort.signal);
      return { ...reply, ...(await this.#decode(reply, abort.signal)) };
    } finally {
      this.#asides.delete(abort);
    }
  }

  /** The newest decoded frame not taken yet, for the screen; older ones are cancelled. */
  take(): DecodedFrame | undefined {
    const frame = this.#ready;
    this.#ready = undefined;
    if (frame === undefined) return undefined;
    this.#shown = frame;
    frame.request.fate = "shown";
    this.#cancel((_, seq) => seq < frame.seq, "a newer frame is on the screen");
    return frame;
  }

  get inFlight(): number {
    return this.#inFlight.size;
  }

  get counts(): PipelineCounts {
    return this.#counts;
  }

  get settled(): boolean {
    return this.#version > 0 && this.#shown.version === this.#version;
  }

  /** Pauses: drops requests in flight and received frames. Afterwards even the same view is requested again. */
  pause(): void {
    this.#cancel(() => true, "the view is not shown");
    this.#drop("the view is not shown");
    this.#shown = { seq: this.#seq - 1, version: 0 };
  }

  dispose(): void {
    this.#drop("the viewer was closed");
  }

  #drop(reason: string): void {
    const all = [...[...this.#inFlight.values()].map(({ abort }) => abort), ...this.#asides];
    for (const abort of all) abort.abort(new FrameDropped(reason));
    this.#inFlight.clear();
    this.#ready?.bitmap.close();
    this.#ready = undefined;
  }

  get #room(): number {
    return Math.min(this.#limit.limit, this.#transport.maxInFlight) - this.#inFlight.size;
  }

  #cancel(which: (entry: Entry, seq: number) => boolean, reason: string): void {
    for (const [seq, entry] of this.#inFlight) {
      if (!which(entry, seq)) continue;
      this.#counts.cancelled++;
      if (entry.request.fate === "unanswered") entry.request.fate = "cancelled";
      this.#inFlight.delete(seq);
      entry.abort.abort(new FrameDropped(reason));
    }
  }

  async #send(view: ViewRequest, pose: number): Promise<void> {
    const seq = this.#seq++;
    const alone = this.#inFlight.size === 0;
    const abort = new AbortController();
    const request: Mutable<SentRequest> = { at: this.#now(), pose, asked: view.profile ?? null, fate: "unanswered" };
    this.#inFlight.set(seq, { version: this.#version, abort, request });
    const version = this.#version;
    this.#counts.sent++;
    this.#pace.sent(request.at);
    this.#events.sent(request);
    try {
      const asked = this.#asked(view, seq);
      const reply = await this.#transport.request(asked, abort.signal);
      if (!abort.signal.aborted) request.fate = "overtaken";
      this.#pace.told(reply.header.requests_per_s ?? null);
      this.#events.replied(reply, view, pose);
      const decoded = await this.#decode(reply, abort.signal);
      if (abort.signal.aborted) {
        decoded.bitmap.close();
        return;
      }
      if (request.asked !== null) this.#observe(reply, alone);
      const { header, image } = reply;
      const askedAt = request.at;
      this.#decoded({ seq, version, pose, header, ...decoded, asked, askedAt, image, request });
    } catch (error) {
      if (abort.signal.aborted) return;
      request.fate = "dropped";
      this.#failed(error, request);
    } finally {
      this.#inFlight.delete(seq);
    }
  }

  #decoded(frame: ReadyFrame): void {
    const newest = Math.max(this.#shown.seq, this.#ready?.seq ?? -1);
    if (frame.seq <= newest) {
      frame.bitmap.close();
      return;
    }
    this.#ready?.bitmap.close();
    this.#ready = frame;
  }

  /** The request with a number, and a format unless it is for a frame of a video. */
  #asked(view: ViewRequest, seq: number): ViewRequest & { readonly seq: number } {
    const format = view.format ?? this.#events.format();
    return { ...view, seq, ...(format !== "jpeg" && { format }) };
  }

  #observe({ header, arrival }: FrameReply, alone: boolean): void {
    const { queue, render, encode } = header.timing ?? { queue: 0, render: 0, encode: 0 };
    const now = this.#now();
    const overhead = Math.max(0, now - arrival.sentAt - queue - render - encode);
    const transmission = this.#events.transmission(arrival.bytes);
    this.#limit.observe({ overhead, render, encode, transmission, alone }, now);
  }

  #failed(error: unknown, { asked }: SentRequest): void {
    this.#counts.dropped++;
    if (asked === null) {
      this.#events.unrefined();
      return;
    }
    if (error instanceof RequestProblem && LATE.has(error.problem.type)) return;
    if (error instanceof FrameDropped) return;
    this.#retryAt = this.#now() + RETRY_AFTER;
    if (error instanceof RequestProblem && error.problem.type !== TOO_OFTEN) this.#events.refused(error);
  }

  *#versionsInFlight(): Iterable<number> {
    for (const { version } of this.#inFlight.values()) yield version;
  }
}

/** Whether two views are equal, field by field; called once per animation frame. */
export function sameView(a: ViewRequest, b: ViewRequest): boolean {
  const names = Object.keys(a) as (keyof ViewRequest)[];
  return names.length === Object.keys(b).length && names.every((name) => sameValue(a[name], b[name]));
}

function sameValue(a: unknown, b: unknown): boolean {
  return Array.isArray(a) && Array.isArray(b)
    ? a.length === b.length && a.every((value, i) => value === b[i])
    : a === b;
}
