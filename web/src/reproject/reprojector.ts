/**
 * Turns the newest picture to the pose of each animation frame, on a canvas over the element that shows pictures as they come: a
 * canvas or a video. The canvas is there only while it works, and hides what is below; nothing is drawn while neither the view nor
 * the picture changes. Across a cut nothing is turned: the picture of before stays until one of after comes.
 */
import { type ReadonlySignal, signal } from "@preact/signals";
import type { Size } from "../enhance/geometry";
import { Overlay } from "../enhance/overlay";
import type { ScenePose } from "../view/camera";
import { isCut } from "../view/cut";
import type { Intrinsics, Viewport } from "../view/intrinsics";
import { type NumberedPose, samePose } from "../view/rig";
import { TimeWindow } from "../view/window";
import { uncoveredShare } from "./coverage";
import type { DepthMap } from "./depth";
import { depthOfView } from "./depth-of-view";
import { KeepingUp } from "./keeping-up";
import { resized, type View } from "./view";
import { Warp, type WarpOptions } from "./warp";

export type ReprojectionStatus = "off" | "on" | "missing" | "unreadable" | "lost" | "slow";

const NOTES: Readonly<Record<ReprojectionStatus, string | null>> = {
  off: null,
  on: null,
  missing: "Reprojection needs WebGL 2, which this browser does not offer. Frames are shown as they come.",
  unreadable:
    "Reprojection of a video needs WebCodecs, which this browser does not offer. Frames are shown as they come.",
  lost: "The graphics processor was lost, so frames are shown as they come.",
  slow: "This machine is too slow to turn each frame. Frames are shown as they come.",
};

/** What a person should know where pictures of any side are not turned although they are to be; else null. */
export function reprojectionNote(...sides: readonly ReprojectionStatus[]): string | null {
  return sides.map((status) => NOTES[status]).find((note) => note !== null) ?? null;
}

/** A picture, and what it shows. */
export interface Content<Frame> {
  /** What is told of it when it is on the screen. */
  readonly frame: Frame;
  /** The number of the pose at which it was asked for. */
  readonly pose: number;
  /** What was asked for, without margins. */
  readonly asked: ScenePose & Lens;
  /** What it shows, margins included, in its own pixels. */
  readonly view: View;
  readonly depth: DepthMap | null;
}

/** What was drawn in an animation frame. */
export interface Turned<Frame> {
  readonly frame: Frame;
  readonly pose: number;
  /** The number of the pose that it was turned to. */
  readonly view: number;
  /** The share of the picture that the newest frame does not cover, as an estimate. */
  readonly filled: number;
  /** How long taking and turning it kept the main thread, in milliseconds. */
  readonly warpMs: number;
  /** The frame was not on the screen before. */
  readonly fresh: boolean;
}

export type Lens = Intrinsics & Viewport;

/** The part of a `Warp` that is used. */
export type Warper = Pick<Warp, "working" | "gpuMs" | "take" | "surround" | "draw" | "forget" | "dispose">;

export interface ReprojectorOptions {
  readonly below: HTMLElement;
  /** How large the picture is displayed, in the screen's pixels. */
  readonly size: () => Size;
  /** In milliseconds. */
  readonly now: () => number;
  /** The browser gives the pictures away; it always does, unless they are a video's. */
  readonly readable?: boolean;
  readonly create?: (canvas: HTMLCanvasElement, options: WarpOptions) => Warper;
}

interface Drawn extends Size {
  readonly pose: NumberedPose;
  readonly lens: Lens;
}

/** More pixels are not drawn while the picture is turned, nor more than so many in a row for each of its own: the browser enlarges it. */
const MOST_PIXELS = 4_194_304;
const MOST_ENLARGED = 2;
/** How far back the main thread's time is looked at, in milliseconds. */
const SPAN = 5000;

export class Reprojector<Frame> {
  readonly #status = signal<ReprojectionStatus>("off");
  readonly #options: Required<ReprojectorOptions>;
  readonly #times = new TimeWindow(SPAN);
  #overlay: Overlay | undefined;
  #warp: Warper | undefined;
  #distance = Number.POSITIVE_INFINITY;
  #content: Content<Frame> | undefined;
  /** The content has not been drawn yet, or not as it is by now. */
  #changed = false;
  /** Its frame has not been told of. */
  #fresh = false;
  #sampled: NumberedPose | undefined;
  /** Since a cut: the first pose after it, until a picture of it comes. */
  #cut: number | undefined;
  /** The first pose after the last cut. */
  #begun = 0;
  /** The sides of the surround that there are, by number. */
  #surround = new Map<number, View>();
  /** The share of what was drawn last that the newest frame does not cover. */
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

  /** The graphics processor's time for a draw, in milliseconds; null where it does not tell. */
  get gpuMs(): number | null {
    return this.#warp?.gpuMs ?? null;
  }

  /** What the picture on the canvas is; undefined while there is none. */
  get content(): Content<Frame> | undefined {
    return this.#drawn && this.#content;
  }

  /** The sides of the surround that there are, by number. */
  get surround(): ReadonlyMap<number, View> {
    return this.#surround;
  }

  /** Turn pictures from the next one on; `distance`: how far away most of the scene is, in its units. */
  on(distance: number): void {
    this.off();
    if (!this.#options.readable) {
      this.#status.value = "unreadable";
      return;
    }
    const overlay = new Overlay(this.#options.below);
    overlay.canvas.classList.add("reprojected");
    this.#overlay = overlay;
    this.#distance = distance;
    this.#pace = new KeepingUp();
    this.#warp = this.#options.create(overlay.canvas, {
      distance,
      onLost: () => {
        this.#hide();
        this.#status.value = "lost";
      },
      onRestored: () => {
        this.#status.value = "on";
      },
    });
    this.#status.value = this.#warp.working ? "on" : "missing";
  }

  off(): void {
    this.#hide();
    this.#warp?.dispose();
    this.#warp = undefined;
    this.#overlay = undefined;
    this.#status.value = "off";
  }

  /**
   * The newest picture, which is copied; `fresh`: it is of another frame. One from before a cut is ignored, and one without depth
   * has that of the picture before, if it was asked for at the same place.
   */
  take(source: TexImageSource, content: Content<Frame>, fresh = true): void {
    if (!this.working || (this.#cut !== undefined && content.pose < this.#cut)) return;
    if (this.#cut !== undefined) {
      this.#warp?.forget();
      this.#surround.clear();
    }
    this.#cut = undefined;
    const begun = this.#options.now();
    const depth = content.depth ?? knownDepth(content, this.#content);
    this.#warp?.take(source, content.view, depth);
    this.#spent += this.#options.now() - begun;
    this.#fresh ||= fresh;
    this.#content = { ...content, depth };
    this.#changed = true;
  }

  /** A side of the surround, asked for at a pose's number; it is copied. One from before a cut is ignored. */
  takeSide(source: TexImageSource, side: number, view: View, pose: number): void {
    if (!this.working || this.#cut !== undefined || pose < this.#begun) return;
    const begun = this.#options.now();
    this.#warp?.surround(source, view);
    this.#spent += this.#options.now() - begun;
    this.#surround.set(side, view);
    this.#changed ||= this.#filled > 0;
  }

  /** Once per animation frame, after the camera was sampled and the newest picture was taken; `pose` may be one that is foretold. */
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
    const begun = this.#options.now();
    if (!this.#pace.drawn(begun)) {
      this.off();
      this.#status.value = "slow";
      return;
    }
    this.#draw(now);
    const ended = this.#options.now();
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

  /** Once per animation frame, first of all: what is on the screen by now and was not in the last one, if anything. */
  presented(): Turned<Frame> | null {
    const turned = this.#untold ?? null;
    this.#untold = undefined;
    return turned;
  }

  /** A copy of what is on the screen; null while pictures are shown as they come. Transparent where nothing was ever seen. */
  picture(): Promise<ImageBitmap> | null {
    if (!this.#drawn || !this.#overlay || !this.working) return null;
    this.#draw(this.#drawn); // what was drawn in another animation frame cannot be read
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

  /** A picture that was asked for just so is shown pixel by pixel; others fill the screen's pixels. */
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

/** The pixels of a picture that are not margins: as many as its pixels per angle make of the view that was asked for. */
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
