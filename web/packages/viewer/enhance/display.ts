/**
 * Shows decoded frames: on one canvas without a model, or enhanced on a second canvas over it. A canvas used for
 * bitmaps cannot become a WebGPU canvas, and the second one does not exist while no model is chosen.
 */

import type { FrameHeader } from "#client/wire/render";
import type { Chain } from "./chain";
import type { Enhancement } from "./enhancement";
import type { Size } from "./geometry";
import type { Overlay } from "./overlay";
import { MOST_FRAMES, Pace } from "./pace";
import type { Drawn, Renderer } from "./renderer";

/** How a frame that is on the screen was enhanced. */
export interface Enhanced extends Size {
  /** The graphics processor's time, in milliseconds. */
  readonly ms: number;
  /** The models that changed it, by name, or `off`. */
  readonly restore: string;
  readonly upscale: string;
  /** Makes a lossless copy of the picture, until the next animation frame. */
  readonly copy: () => ImageBitmap;
}

/** A frame on screen without enhancement. */
export interface OnScreen<Frame> {
  readonly frame: Frame;
  readonly enhanced: Enhanced | null;
}

/** Input of the display: a bitmap, its rung, and its margins beyond the visible part. */
interface Decoded {
  readonly bitmap: ImageBitmap;
  readonly header: Pick<FrameHeader, "profile" | "margin_x" | "margin_y">;
}

/** Ratios of a picture's size with margins to its size without. */
interface Extent {
  readonly across: number;
  readonly down: number;
}

/** An enhanced picture on the overlay; `fresh`: the first picture of its frame. */
export interface Arrived<Frame> {
  readonly frame: Frame;
  readonly enhanced: Enhanced;
  readonly fresh: boolean;
}

/** A frame that is being enhanced. */
interface Pending<Frame> {
  readonly picture: Frame;
  /** Null: not reported. */
  frame: Frame | null;
  readonly renderer: Renderer;
  readonly names: ReturnType<Chain["names"]>;
  readonly drawn: Drawn;
  readonly extent: Extent;
  /** The time that it took, once it is done. */
  ms: number | null;
  /** Animation frames since it was started. */
  age: number;
}

export interface DisplayOptions {
  /** Canvas for frames without enhancement. */
  readonly canvas: HTMLCanvasElement;
  /** Overlay for enhanced frames. */
  readonly overlay: Overlay;
  readonly enhancement: Enhancement;
  /** Displayed size of pictures without margins, in the screen's pixels. */
  readonly size: () => Size;
}

/** Number of frames in progress: the next one starts before the last one is known to be complete. */
const AT_ONCE = MOST_FRAMES - 1;
/** A frame incomplete after this many animation frames is abandoned. */
const PATIENCE = 60;

export class Display<Frame extends Decoded> {
  readonly #options: DisplayOptions;
  readonly #context: ImageBitmapRenderingContext;
  readonly #pace = new Pace();
  #pending: readonly Pending<Frame>[] = [];
  #onScreen: Pending<Frame> | null = null;
  /** Drawn to the plain canvas and not reported yet. */
  #raw: Frame | null = null;
  /** Appeared on the overlay in this animation frame. */
  #arrived: Arrived<Frame> | null = null;
  /** The newest enhanced frame, before enhancement. */
  #newest: Frame | null = null;
  /** The newest frame; the canvas owns its bitmap if it was shown without enhancement. */
  #latest: Frame | null = null;
  /** Number of frames shown. */
  #shows = 0;
  /** Whether the picture on the screen must be enhanced again. */
  #stale = false;
  /** Reason to drop the models in the next animation frame: subscribers may still copy the current picture. */
  #verdict: string | null = null;
  /**
   * A frame is about to be shown without enhancement; its bitmap is invalid afterwards. `fresh`: no picture of it was
   * shown before.
   */
  onRaw: (frame: Frame, fresh: boolean) => void = () => undefined;

  constructor(options: DisplayOptions) {
    this.#options = options;
    const context = options.canvas.getContext("bitmaprenderer");
    if (context === null) throw new Error("this browser cannot draw decoded images");
    this.#context = context;
    options.enhancement.onChange = () => this.#changed();
  }

  /** Whether another frame can be taken now. */
  get ready(): boolean {
    return this.#pending.length < AT_ONCE;
  }

  /** Whether models will enhance the next frame. */
  get enhances(): boolean {
    return this.#options.enhancement.active !== null;
  }

  /** Whether no frame is in progress. */
  get settled(): boolean {
    return this.#pending.length === 0;
  }

  /** Takes a frame, and ownership of its bitmap. */
  show(frame: Frame): void {
    const { bitmap, header } = frame;
    this.#shows++;
    this.#stale = false;
    this.#latest = frame;
    // Refinements are not enhanced: they have the screen's resolution, or will soon.
    const rung = header.profile ?? null;
    if (rung !== null) this.#options.enhancement.seen({ width: bitmap.width, height: bitmap.height, rung });
    if (rung === null || !this.#enhance(frame, frame)) this.#draw(frame, frame);
  }

  /** Called first in each animation frame: the frame that has appeared on the screen since the last one, if any. */
  presented(now: number): OnScreen<Frame> | null {
    this.#pace.tick(now);
    if (this.#verdict !== null) this.#options.enhancement.giveUp(this.#verdict);
    const raw = this.#raw;
    this.#raw = null;
    const enhanced = this.#takeDone();
    if (this.#stale && this.ready) void this.#enhanceAnew();
    return raw ? { frame: raw, enhanced: null } : enhanced;
  }

  /** The picture shown on the overlay in this animation frame, if any. */
  get arrived(): Arrived<Frame> | null {
    return this.#arrived;
  }

  /** Stops reporting frames that are not on the screen yet. */
  forget(): void {
    this.#raw = null;
    for (const pending of this.#pending) pending.frame = null;
  }

  /** A lossless copy of the screen. */
  async picture(): Promise<ImageBitmap> {
    const shown = this.#onScreen;
    return shown ? shown.renderer.copy(shown.drawn) : createImageBitmap(this.#options.canvas);
  }

  dispose(): void {
    this.#keep(null);
    this.#options.overlay.hide();
  }

  /** Removes the frames that are done from the list; the newest of them is on the screen. */
  #takeDone(): OnScreen<Frame> | null {
    for (const pending of this.#pending) pending.age++;
    const working = this.#pending.findIndex(({ ms }) => ms === null);
    const done = working === -1 ? this.#pending : this.#pending.slice(0, working);
    this.#pending = this.#pending.slice(done.length);
    const last = done.at(-1);
    this.#arrived = null;
    if (last) {
      this.#release([...done.slice(0, -1), this.#onScreen]);
      this.#onScreen = last;
      hideMargins(this.#options.overlay.canvas, last.extent);
    }
    const frame = done.findLast((one) => one.frame !== null)?.frame ?? undefined;
    this.#watch(done);
    if (!last) return null;
    const { picture, drawn, renderer, names, ms } = last;
    const { width, height } = drawn;
    const enhanced = { width, height, ms: ms ?? 0, ...names, copy: () => renderer.copy(drawn) };
    this.#arrived = { frame: picture, enhanced, fresh: frame !== undefined };
    return frame ? { frame, enhanced } : null;
  }

  #watch(done: readonly Pending<Frame>[]): void {
    const tooLong = done.map(({ ms }) => this.#pace.observe(ms ?? 0)).findLast((time) => time !== null);
    if (tooLong) {
      const [took, display] = [tooLong, this.#pace.interval].map((time) => Math.round(time));
      this.#verdict = `It took ${took} ms per frame, but the display shows one every ${display} ms.`;
    } else if ((this.#pending[0]?.age ?? 0) > PATIENCE) {
      this.#verdict = "The graphics processor is too slow.";
    }
  }

  /** Hands a picture to the graphics processor; returns whether that was possible. */
  #enhance(picture: Frame, frame: Frame | null): boolean {
    const { enhancement, overlay } = this.#options;
    const { active } = enhancement;
    const { width, height } = this.#sizeWithMargins(picture);
    if (active === null || width < 1 || height < 1) return false;
    const { renderer, chain } = active;
    const rung = picture.header.profile ?? null;
    let drawn: Drawn;
    try {
      drawn = renderer.draw(picture.bitmap, rung, chain, { width, height });
    } catch (error) {
      enhancement.giveUp(sentence(error));
      return false;
    }
    const extent = extentOf(picture);
    const names = chain.names(rung);
    const pending: Pending<Frame> = { picture, frame, renderer, names, drawn, extent, ms: null, age: 0 };
    drawn.done.then(
      (ms) => {
        pending.ms = ms;
      },
      () => undefined, // the device was lost, as reported to `enhancement`
    );
    if (chain.crowded) enhancement.renew();
    this.#pending = [...this.#pending, pending];
    this.#keep(picture);
    overlay.show();
    return true;
  }

  /** Enhances the current frame with newly chosen models, as a resting camera receives no frames. */
  async #enhanceAnew(): Promise<void> {
    this.#stale = false;
    if (this.#newest) {
      this.#enhance(this.#newest, null);
      return;
    }
    const shows = this.#shows;
    const latest = this.#latest;
    const bitmap = await createImageBitmap(this.#options.canvas).catch(() => null); // there will be another frame
    if (bitmap === null || latest === null) return;
    const picture = { ...latest, bitmap };
    if (shows !== this.#shows || !this.#enhance(picture, null)) bitmap.close();
  }

  /** The size with margins at which a picture's visible part fills the screen's pixels. */
  #sizeWithMargins(picture: Frame): Size {
    const { width, height } = this.#options.size();
    const { across, down } = extentOf(picture);
    return { width: Math.round(width * across), height: Math.round(height * down) };
  }

  /** Shows a frame without enhancement. A canvas does not adopt the proportions of its bitmap and would stretch it. */
  #draw(picture: Frame, frame: Frame | null): void {
    const { canvas, overlay } = this.#options;
    const { bitmap } = picture;
    this.onRaw(picture, frame !== null);
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      canvas.width = bitmap.width;
      canvas.height = bitmap.height;
    }
    hideMargins(canvas, extentOf(picture));
    this.#context.transferFromImageBitmap(bitmap);
    this.#raw = frame;
    this.#keep(null);
    this.#release([...this.#pending, this.#onScreen]);
    this.#pending = [];
    this.#onScreen = null;
    this.#arrived = null;
    overlay.hide();
  }

  /** Called when other models enhance frames from now on, or none. */
  #changed(): void {
    this.#pace.reset();
    this.#verdict = null;
    this.#stale = this.#options.enhancement.active !== null && this.#shows > 0;
    if (this.#options.enhancement.active !== null || this.#newest === null) return;
    const untold = this.#pending.findLast(({ frame }) => frame !== null)?.frame ?? null;
    const picture = this.#newest;
    this.#newest = null; // its bitmap goes to the canvas
    this.#draw(picture, untold);
  }

  #keep(picture: Frame | null): void {
    if (picture !== this.#newest) this.#newest?.bitmap.close();
    this.#newest = picture;
  }

  #release(frames: readonly (Pending<Frame> | null)[]): void {
    for (const frame of frames) frame?.renderer.release(frame.drawn);
  }
}

function extentOf({ bitmap: { width, height }, header }: Decoded): Extent {
  const times = (length: number, margin: number | null | undefined) => length / (length - 2 * (margin ?? 0));
  return { across: times(width, header.margin_x), down: times(height, header.margin_y) };
}

/** Keeps margins outside the pane: they would otherwise appear once warping stops, and shrink the view. */
function hideMargins(canvas: HTMLCanvasElement, { across, down }: Extent): void {
  const scale = `${across} ${down}`;
  if (scales.get(canvas) === scale) return;
  canvas.style.scale = scale;
  scales.set(canvas, scale);
}

/** Scales already set: a style is parsed even if it is unchanged. */
const scales = new WeakMap<HTMLCanvasElement, string>();

function sentence(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
