/**
 * "Still means sharp": once the camera rests, the view is asked for again with more pixels, up to those of the screen. Each step
 * is a whole picture: as large as the link takes in a moment, or four times the one before, as long as the server does not work
 * on it for long, because what it has begun it finishes before it turns to new movement. On a link that would take longer than
 * some seconds for the screen's pixels, the largest step that it takes in that time is the last. Pure: times come in.
 */
import { resized, type View } from "../reproject/view";
import type { FrameReply } from "../transport/transport";
import { type Viewport, viewportFor } from "../view/intrinsics";
import { sameView, type ViewRequest } from "./pipeline";

/** The camera rests when its view was the same for so long, in milliseconds. */
const STILL_AFTER = 150;
/** A first step takes the link no longer, unless that is no better than what is shown; in milliseconds. */
const MOMENT = 150;
/** Nor does any step keep the server for longer than this, or the link; in milliseconds. */
const LONGEST_SERVER = 300;
const LONGEST_LINK = 3000;
/** A step has so many times the pixels of the one before, at most, where the link takes longer than a moment, and at least. */
const GROWTH = 4;
const LEAST_GROWTH = 1.3;
/** Bytes a pixel until a step has told: those of the paper's best rung. */
const BYTES_A_PIXEL = 240_000 / (1280 * 720);

/** A view as the page asks for it: by a pose, for a viewport. */
export type PosedRequest = ViewRequest & View;

/** What the next step follows from. */
export interface Circumstances {
  readonly now: number;
  /** The view that was asked for last is on the screen. */
  readonly settled: boolean;
  /** Of the link, in bits per second; null while unknown. */
  readonly throughput: number | null;
  /** Pixels of the screen along one of the viewport's. */
  readonly pixelRatio: number;
}

export class Refinement {
  #still: { readonly view: PosedRequest; readonly pixelRatio: number; readonly since: number } | undefined;
  /** What was asked for last, and what of it was seen. */
  #step: PosedRequest | null = null;
  #shown: PosedRequest | null = null;
  #finished = false;
  /** Of the last frame that came, without margins. */
  #frame = { pixels: 0, best: false };
  #bytesAPixel = BYTES_A_PIXEL;
  #serverMsAPixel = 0;

  /** Whether the view will be asked for with more pixels, if it stays. */
  get pending(): boolean {
    return !this.#finished;
  }

  /** Once per animation frame: what to ask for instead of `view` at its rung; null for that itself. */
  next(view: PosedRequest, circumstances: Circumstances): PosedRequest | null {
    const { now, settled, pixelRatio } = circumstances;
    const { profile: _, overscan: __, depth: ___, format: ____, video: _____, ...plain } = view; // a picture by itself
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

  /** A frame came, of a rung or of a step. */
  observe({ header, arrival }: Pick<FrameReply, "header" | "arrival">): void {
    const { width, height, margin_x, margin_y, profile, timing, video } = header;
    if (!width || !height) return;
    const inner = (width - 2 * (margin_x ?? 0)) * (height - 2 * (margin_y ?? 0));
    this.#frame = { pixels: inner, best: profile === 0 && !video };
    if (timing) this.#serverMsAPixel = (timing.render + timing.encode) / (width * height);
    if (profile == null) this.#bytesAPixel = arrival.bytes / (width * height);
  }

  /** The step that was asked for will not come: what was seen stays, until the view is another. */
  failed(): void {
    this.#step = this.#shown;
    this.#finished = true;
  }

  /** Null if there is none that would look better. */
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
