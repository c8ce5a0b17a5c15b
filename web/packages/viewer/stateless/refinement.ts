/**
 * "Still means sharp": once the camera rests, the view is requested again with more pixels, up to those of the screen.
 * Each step is a whole picture, as large as the link carries in a short time or four times the previous one, limited by
 * server time, because the server finishes a started step before it turns to new movement. On a link that would take
 * longer than a few seconds for the screen's pixels, the largest step that fits that time is the last. Pure: time is an
 * argument.
 */
import type { FrameReply } from "#client/transport/transport";
import { resized, type View } from "../reproject/view";
import { type Viewport, viewportFor } from "../view/intrinsics";
import { sameView, type ViewRequest } from "./pipeline";

/**
 * Suppresses requests for a resting view that would not improve it: a frame of a worse rung or with narrower margins
 * shows nothing new. On a slow link it would delay other frames for seconds.
 */
export class Rest<Request extends ViewRequest> {
  #last: Request | undefined;
  #chooser: unknown;

  /** The request that replaces a view with a rung chosen by `chooser`; other choices always count. */
  view(view: Request, chooser: unknown): Request {
    const last = this.#last;
    if (last && chooser === this.#chooser && isLess(view, last)) return last;
    this.#last = view;
    this.#chooser = chooser;
    return view;
  }
}

/** Whether a request is for the same view as another, with no better rung or bit rate and no wider margins. */
function isLess(view: ViewRequest, than: ViewRequest): boolean {
  const { profile, overscan = 0, video, ...rest } = view;
  const { profile: best, overscan: widest = 0, video: clearest, ...same } = than;
  if (profile == null || best == null || profile < best || overscan > widest) return false;
  if ((video?.bitrate_kbps ?? 0) > (clearest?.bitrate_kbps ?? 0)) return false;
  return sameView(rest as ViewRequest, same as ViewRequest);
}

/** The camera rests after its view has not changed for this many milliseconds. */
const STILL_AFTER = 150;
/** Longest link time of a first step in milliseconds, unless it would look no better than the current frame. */
const MOMENT = 150;
/** Longest time of any step on the server, and on the link, in milliseconds. */
const LONGEST_SERVER = 300;
const LONGEST_LINK = 3000;
/** Largest growth in pixels per step on a slow link, and the smallest growth. */
const GROWTH = 4;
const LEAST_GROWTH = 1.3;
/** Bytes per pixel before the first step, as on the paper's best rung. */
const BYTES_A_PIXEL = 240_000 / (1280 * 720);

/** A view as the page requests it: by a pose, for a viewport. */
export type PosedRequest = ViewRequest & View;

export interface Circumstances {
  readonly now: number;
  /** Whether the last requested view is on the screen. */
  readonly settled: boolean;
  /** Throughput of the link in bits per second; null while unknown. */
  readonly throughput: number | null;
  /** Screen pixels per viewport pixel. */
  readonly pixelRatio: number;
}

export class Refinement {
  #still: { readonly view: PosedRequest; readonly pixelRatio: number; readonly since: number } | undefined;
  /** The last request, and the best of its pictures that was shown. */
  #step: PosedRequest | null = null;
  #shown: PosedRequest | null = null;
  #finished = false;
  /** Size of the last received frame, without margins. */
  #frame = { pixels: 0, best: false };
  #bytesAPixel = BYTES_A_PIXEL;
  #serverMsAPixel = 0;

  /** Whether a resting view will be requested with more pixels. */
  get pending(): boolean {
    return !this.#finished;
  }

  /** Called once per animation frame: the request that replaces `view` at its rung, or null. */
  next(view: PosedRequest, circumstances: Circumstances): PosedRequest | null {
    const { now, settled, pixelRatio } = circumstances;
    const { profile: _, overscan: __, depth: ___, format: ____, video: _____, ...plain } = view; // a single picture
    if (this.#still?.pixelRatio !== pixelRatio || !sameView(plain, this.#still.view)) {
      this.#still = { view: plain, pixelRatio, since: now };
      this.#step = this.#shown = null;
      this.#finished = false;
    }
    if (this.#finished || !settled || now - this.#still.since < STILL_AFTER) return this.#step;
    this.#shown = this.#step;
    const step = this.#larger(plain, circumstances);
    this.#finished = step === null;
    this.#step = step ?? this.#step;
    return this.#step;
  }

  observe({ header, arrival }: Pick<FrameReply, "header" | "arrival">): void {
    const { width, height, margin_x, margin_y, profile, timing, video } = header;
    if (!width || !height) return;
    const inner = (width - 2 * (margin_x ?? 0)) * (height - 2 * (margin_y ?? 0));
    this.#frame = { pixels: inner, best: profile === 0 && !video };
    if (timing) this.#serverMsAPixel = (timing.render + timing.encode) / (width * height);
    if (profile == null) this.#bytesAPixel = arrival.bytes / (width * height);
  }

  /** Stops after a failed step: the picture on the screen stays until the view changes. */
  failed(): void {
    this.#step = this.#shown;
    this.#finished = true;
  }

  /** The next larger step; null if none would look better. */
  #larger(view: PosedRequest, { throughput, pixelRatio }: Circumstances): PosedRequest | null {
    if (this.#frame.pixels === 0) return null;
    const screen = viewportFor(view.width * pixelRatio, view.height * pixelRatio);
    const all = screen.width * screen.height;
    const inLink = (ms: number) => (ms * (throughput ?? 0)) / 8000 / this.#bytesAPixel;
    const longest = throughput === null ? all : inLink(LONGEST_LINK);
    const most = Math.min(longest, LONGEST_SERVER / this.#serverMsAPixel);
    const pixels = Math.min(most, Math.max(inLink(MOMENT), GROWTH * this.#frame.pixels));
    if (pixels >= all) {
      const there = this.#step?.width === screen.width && this.#step.height === screen.height;
      return there || (this.#frame.best && this.#frame.pixels >= all) ? null : enlarged(view, screen);
    }
    if (pixels < LEAST_GROWTH * this.#frame.pixels) return null;
    const scale = Math.sqrt(pixels / all);
    const size = { width: Math.floor(screen.width * scale), height: Math.floor(screen.height * scale) };
    return { ...enlarged(view, size), display_scale: screen.width / size.width };
  }
}

/** The same view with other pixels. */
function enlarged(view: PosedRequest, { width, height }: Viewport): PosedRequest {
  const { fx, fy, cx, cy } = resized(view, width, height);
  return { ...view, fx, fy, cx, cy, width, height };
}
