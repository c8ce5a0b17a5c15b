/**
 * Warps the newest picture to the pose of each animation frame, on a canvas over the element that shows plain pictures:
 * a canvas or a video. The canvas exists only while needed and hides the element below; nothing is drawn while view and
 * picture are unchanged. Nothing is warped across a cut: the old picture stays until a new one arrives.
 */
import { type ReadonlySignal, signal } from "@preact/signals";
import type { DepthMap } from "#client/transport/transport";
import type { Size } from "../enhance/geometry";
import { Overlay } from "../enhance/overlay";
import { isCut, type ScenePose } from "../view/camera";
import type { Intrinsics, Viewport } from "../view/intrinsics";
import { type NumberedPose, samePose } from "../view/rig";
import { TimeWindow } from "../view/window";
import { turning } from "./acceleration";
import { uncoveredShare } from "./coverage";
import { depthOfView } from "./depth-of-view";
import { KeepingUp } from "./keeping-up";
import { resized, type View } from "./view";
import { Warp, type WarpOptions } from "./warp";

export type ReprojectionStatus = "off" | "on" | "unreadable" | "lost" | "slow";

const NOTES: Readonly<Record<ReprojectionStatus, string | null>> = {
  off: null,
  on: null,
  unreadable: "This browser has no WebCodecs: smooth turning of the stream is off.",
  lost: "The graphics processor was lost: smooth turning is off.",
  slow: "This browser draws without the graphics processor: smooth turning is off.",
};

/** Why the pictures of one of the sides are not turned as chosen; null if they are. */
export function reprojectionNote(...sides: readonly ReprojectionStatus[]): string | null {
  return sides.map((status) => NOTES[status]).find((note) => note !== null) ?? null;
}

export interface Content<Frame> {
  /** Properties reported when it is on screen. */
  readonly frame: Frame;
  /** Number of the pose for which it was requested. */
  readonly pose: number;
  /** The requested view, without margins. */
  readonly asked: ScenePose & Lens;
  /** The view, margins included, in its own pixels. */
  readonly view: View;
  readonly depth: DepthMap | null;
}

/** Result of an animation frame. */
export interface Turned<Frame> {
  readonly frame: Frame;
  readonly pose: number;
  /** The number of the pose that it was turned to. */
  readonly view: number;
  /** Estimated share of the picture that the newest frame does not cover. */
  readonly filled: number;
  /** Main thread's time to take and turn it, in milliseconds. */
  readonly warpMs: number;
  /** Whether the frame is on the screen for the first time. */
  readonly fresh: boolean;
}

export type Lens = Intrinsics & Viewport;

/** The part of a `Warp` that is used. */
export type Warper = Pick<Warp, "working" | "gpuMs" | "take" | "surround" | "draw" | "forget" | "dispose">;

export interface ReprojectorOptions {
  readonly below: HTMLElement;
  readonly size: () => Size;
  /** Whether the browser lets the pictures be read; always, unless they are a video's. */
  readonly readable?: boolean;
  readonly create?: (canvas: HTMLCanvasElement, options: WarpOptions) => Warper;
}

interface Drawn extends Size {
  readonly pose: NumberedPose;
  readonly lens: Lens;
}

/** Maximum pixels of a warped picture, and maximum pixels per picture pixel in a row: the browser scales it up. */
const MOST_PIXELS = 4_194_304;
const MOST_ENLARGED = 2;
/** Window of the main thread's time, in milliseconds. */
const SPAN = 5000;

export class Reprojector<Frame> {
  readonly #status = signal<ReprojectionStatus>("off");
  readonly #options: Required<ReprojectorOptions>;
  readonly #times = new TimeWindow(SPAN);
  #overlay: Overlay | undefined;
  #warp: Warper | undefined;
  #distance = Number.POSITIVE_INFINITY;
  #content: Content<Frame> | undefined;
  /** Whether the content has changed since the last draw. */
  #changed = false;
  /** Whether its frame has not been reported yet. */
  #fresh = false;
  #sampled: NumberedPose | undefined;
  /** After a cut: the first pose, until its picture arrives. */
  #cut: number | undefined;
  /** The first pose after the last cut. */
  #begun = 0;
  /** The available sides of the surround, by number. */
  #surround = new Map<number, View>();
  /** The share of the last drawn view not covered by the newest frame. */
  #filled = 0;
  #drawn: Drawn | undefined;
  #untold: Turned<Frame> | undefined;
  /** The main thread's time since the last draw, in milliseconds. */
  #spent = 0;
  #pace = new KeepingUp();

  constructor(options: ReprojectorOptions) {
    this.#options = { readable: true, create: (canvas, warp) => new Warp(canvas, warp), ...options };
  }

  get status(): ReadonlySignal<ReprojectionStatus> {
    return this.#status;
  }

  get working(): boolean {
    return this.#warp?.working === true;
  }

  /** The main thread's time for an animation frame, median of the last seconds, in milliseconds. */
  warpMs(now: number): number | null {
    return this.#times.percentile(0.5, now);
  }

  get gpuMs(): number | null {
    return this.#warp?.gpuMs ?? null;
  }

  /** Properties of the picture on the canvas; undefined without one. */
  get content(): Content<Frame> | undefined {
    return this.#drawn && this.#content;
  }

  get surround(): ReadonlyMap<number, View> {
    return this.#surround;
  }

  /** Turns pictures from the next one on; `distance` is how far away most of the scene is, in its units. */
  on(distance: number): void {
    this.off();
    if (!this.#options.readable) {
      this.#status.value = "unreadable";
      return;
    }
    if (turning.peek() === "slow") {
      this.#status.value = "slow";
      return;
    }
    const forced = turning.peek() === "forced";
    const overlay = new Overlay(this.#options.below);
    overlay.canvas.classList.add("reprojected");
    this.#overlay = overlay;
    this.#distance = distance;
    this.#pace = new KeepingUp(forced);
    this.#warp = this.#options.create(overlay.canvas, {
      distance,
      accelerated: !forced,
      onLost: () => {
        this.#hide();
        this.#status.value = "lost";
      },
      onRestored: () => {
        this.#status.value = "on";
      },
    });
    this.#status.value = this.#warp.working ? "on" : "slow";
  }

  off(): void {
    this.#hide();
    this.#warp?.dispose();
    this.#warp = undefined;
    this.#overlay = undefined;
    this.#status.value = "off";
  }

  /**
   * Sets the newest picture, which is copied; `fresh`: it is of another frame. Pictures from before a cut are ignored;
   * one without depth takes that of the previous picture if requested at the same position.
   */
  take(source: TexImageSource, content: Content<Frame>, fresh = true): void {
    if (!this.working || (this.#cut !== undefined && content.pose < this.#cut)) return;
    if (this.#cut !== undefined) {
      this.#warp?.forget();
      this.#surround.clear();
    }
    this.#cut = undefined;
    const begun = performance.now();
    const depth = content.depth ?? knownDepth(content, this.#content);
    this.#warp?.take(source, content.view, depth);
    this.#spent += performance.now() - begun;
    this.#fresh ||= fresh;
    this.#content = { ...content, depth };
    this.#changed = true;
  }

  /** Adds a side of the surround, requested at a pose's number; it is copied. Sides from before a cut are ignored. */
  takeSide(source: TexImageSource, side: number, view: View, pose: number): void {
    if (!this.working || this.#cut !== undefined || pose < this.#begun) return;
    const begun = performance.now();
    this.#warp?.surround(source, view);
    this.#spent += performance.now() - begun;
    this.#surround.set(side, view);
    this.#changed ||= this.#filled > 0;
  }

  /**
   * Called once per animation frame, after sampling the camera and taking the newest picture; `pose` may be predicted.
   */
  turn(pose: NumberedPose, lens: Lens): void {
    const before = this.#sampled;
    this.#sampled = pose;
    if (!this.working) return;
    const cut = before !== undefined && before.seq !== pose.seq && isCut(before, pose, this.#distance);
    if (cut) this.#cut = this.#begun = pose.seq;
    const content = this.#content;
    if (content === undefined || this.#cut !== undefined) return;
    const { width, height } = this.#sizeFor(content, pose, lens);
    if (width < 1 || height < 1) return;
    const now: Drawn = { pose, lens, width, height };
    if (!this.#changed && this.#drawn && sameDrawing(now, this.#drawn)) {
      this.#pace.rested();
      return;
    }
    const begun = performance.now();
    if (!this.#pace.drawn(begun)) {
      turning.value = "slow";
      this.off();
      this.#status.value = "slow";
      return;
    }
    this.#draw(now);
    const ended = performance.now();
    const warpMs = this.#spent + ended - begun;
    this.#times.add(warpMs, ended);
    this.#spent = 0;
    this.#filled = uncoveredShare(content.view, viewOf(now), 1 / this.#distance);
    const { frame, pose: shown } = content;
    this.#untold = { frame, pose: shown, view: pose.seq, filled: this.#filled, warpMs, fresh: this.#fresh };
    this.#changed = false;
    this.#fresh = false;
    this.#overlay?.show();
  }

  /** Resumes after the page was hidden: late draws say nothing about this machine. */
  resumed(): void {
    this.#pace.rested();
    this.#untold = undefined;
  }

  /** Called at the start of each animation frame: the change on screen since the last one, if any. */
  presented(): Turned<Frame> | null {
    const turned = this.#untold ?? null;
    this.#untold = undefined;
    return turned;
  }

  /** A copy of the screen; null while pictures are shown without a warp. Unseen directions are transparent. */
  picture(): Promise<ImageBitmap> | null {
    if (!this.#drawn || !this.#overlay || !this.working) return null;
    this.#draw(this.#drawn); // a drawing of another animation frame cannot be read
    return createImageBitmap(this.#overlay.canvas);
  }

  #draw(drawn: Drawn): void {
    const canvas = this.#overlay?.canvas;
    if (canvas === undefined) return;
    if (canvas.width !== drawn.width || canvas.height !== drawn.height) {
      canvas.width = drawn.width;
      canvas.height = drawn.height;
    }
    this.#drawn = drawn;
    this.#warp?.draw(viewOf(drawn));
  }

  /** A picture requested for exactly this view is shown pixel by pixel; others fill the screen's pixels. */
  #sizeFor({ asked, view }: Content<Frame>, pose: NumberedPose, lens: Lens): Size {
    if (samePose(asked, pose) && sameLens(asked, lens)) return innerSize(asked, view);
    const { width, height } = this.#options.size();
    const useful = (MOST_ENLARGED * innerSize(asked, view).width) / width;
    const scale = Math.min(1, useful, Math.sqrt(MOST_PIXELS / (width * height)));
    return { width: Math.round(width * scale), height: Math.round(height * scale) };
  }

  #hide(): void {
    this.#overlay?.hide();
    this.#content = this.#drawn = this.#untold = this.#cut = undefined;
    this.#changed = this.#fresh = false;
    this.#surround.clear();
    this.#filled = 0;
  }
}

function viewOf({ pose: { position, quaternion }, lens, width, height }: Drawn): View {
  return resized({ position, quaternion, ...lens }, width, height);
}

/** The pixels of a picture without margins, from its angular resolution and the requested view. */
function innerSize(asked: Lens, view: View): Size {
  return {
    width: Math.round((asked.width * view.fx) / asked.fx),
    height: Math.round((asked.height * view.fy) / asked.fy),
  };
}

function knownDepth<Frame>({ asked, view }: Content<Frame>, before: Content<Frame> | undefined): DepthMap | null {
  if (!before?.depth || !samePose(asked, before.asked)) return null;
  return depthOfView(before.depth, before.view, view);
}

function sameDrawing(a: Drawn, b: Drawn): boolean {
  return (
    samePose(a.pose, b.pose) &&
    a.pose.seq === b.pose.seq &&
    a.width === b.width &&
    a.height === b.height &&
    sameLens(a.lens, b.lens)
  );
}

function sameLens(a: Lens, b: Lens): boolean {
  return (["fx", "fy", "cx", "cy", "width", "height"] as const).every((name) => a[name] === b[name]);
}
