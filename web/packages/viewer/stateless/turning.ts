/**
 * Reprojection of stateless frames: hands displayed pictures to the warp, and extends requests so that they can be
 * warped.
 */

import type { RenderRequest, SceneInfo } from "#client/wire/render";
import type { Display, Enhanced } from "../enhance/display";
import { AutoOverscan } from "../reproject/overscan";
import type { Reprojector } from "../reproject/reprojector";
import { resized, viewOfFrame } from "../reproject/view";
import type { SideSettings } from "../state/settings";
import { viewDistance } from "../view/camera";
import type { PresentedFrame } from "../view/presented";
import type { NumberedPose, Rig } from "../view/rig";
import type { DecodedFrame } from "./pipeline";

/** Properties of a picture, passed on each warp. */
export type Pictured = Pick<PresentedFrame, "rung" | "width" | "height" | "shownWidth" | "shownHeight" | "enhanceMs">;

/** Models allocate memory per frame size, so margins of enhanced frames have few sizes. */
const COARSE = 0.125;
/** Default margins of a video. */
const VIDEO_OVERSCAN = 0.1;

export interface TurningOptions {
  readonly display: Display<DecodedFrame>;
  readonly reprojector: Reprojector<Pictured>;
  readonly rig: Rig;
  readonly settings: { peek(): Pick<SideSettings, "overscan" | "depth"> };
}

export class Turning {
  readonly #options: TurningOptions;
  #scene: SceneInfo | undefined;
  #overscan = new AutoOverscan();

  constructor(options: TurningOptions) {
    this.#options = options;
    options.display.onRaw = (frame, fresh) => this.#take(frame.bitmap, frame, pictured(frame, null), fresh);
  }

  /** Whether pictures are turned; otherwise they are shown unchanged. */
  get working(): boolean {
    return this.#options.reprojector.working;
  }

  /**
   * Additional fields of a request. In a video, each size starts with a key frame and there is no depth, so margins are
   * constant.
   */
  request(scene: SceneInfo, now: number, video: boolean): Pick<RenderRequest, "overscan" | "depth"> {
    if (!this.working) return {};
    const { overscan, depth } = this.#options.settings.peek();
    if (video) return { overscan: overscan === "auto" ? VIDEO_OVERSCAN : overscan };
    if (scene !== this.#scene) this.#overscan = new AutoOverscan(viewDistance(scene));
    this.#scene = scene;
    const share = overscan === "auto" ? this.#auto(now) : overscan;
    return { ...(share > 0 && { overscan: share }), ...(depth && { depth: true }) };
  }

  /** Called once per animation frame while it works, after the newest frame was handed to the display: shows it as seen from `pose`. */
  turn(pose: NumberedPose, now: number): void {
    const { display, reprojector, rig } = this.#options;
    const arrived = display.arrived;
    if (arrived) {
      const { frame, enhanced, fresh } = arrived;
      const picture = enhanced.copy();
      this.#take(picture, frame, pictured(frame, enhanced), fresh);
      picture.close();
    }
    const lens = { ...rig.intrinsics.value, ...rig.viewport.value };
    reprojector.turn(pose, lens);
    const { content } = reprojector;
    if (content) this.#overscan.observe(content.asked, { ...pose, ...lens }, now);
  }

  #auto(now: number): number {
    const share = this.#overscan.at(now);
    return this.#options.display.enhances ? COARSE * Math.ceil(share / COARSE) : share;
  }

  #take(source: ImageBitmap, frame: DecodedFrame, about: Pictured, fresh: boolean): void {
    const { header, pose, depth } = frame;
    const { position, quaternion, fx, fy, cx, cy, width, height } = frame.asked;
    if (!position || !quaternion) return; // a pose by its angles, which the page never requests
    const asked = { position, quaternion, fx, fy, cx, cy, width, height };
    const encoded = {
      width: header.width ?? source.width,
      height: header.height ?? source.height,
      marginX: header.margin_x ?? 0,
      marginY: header.margin_y ?? 0,
    };
    const view = resized(viewOfFrame(asked, encoded), source.width, source.height); // it may have been upscaled
    this.#options.reprojector.take(source, { frame: about, pose, asked, view, depth }, fresh);
  }
}

export function pictured({ header }: DecodedFrame, enhanced: Enhanced | null): Pictured {
  return {
    rung: header.profile ?? null,
    width: header.width ?? 0,
    height: header.height ?? 0,
    ...(enhanced && { shownWidth: enhanced.width, shownHeight: enhanced.height, enhanceMs: enhanced.ms }),
  };
}
