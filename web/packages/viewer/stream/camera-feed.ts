/**
 * Sends the camera to the packager and remembers each message: every frame of the stream names the message it was
 * rendered from.
 */
import type { PoseUpdate } from "#client/wire/dash";
import type { Foresight } from "../predict/foresight";
import { resized } from "../reproject/view";
import type { ScenePose } from "../view/camera";
import { type Intrinsics, type Viewport, viewportFor } from "../view/intrinsics";
import { type Rig, samePose } from "../view/rig";

/** Default margin of a stream; changing it would mean opening another stream. */
export const AUTO_OVERSCAN = 0.1;

/** The same camera with this margin at each side, as a share of width and height; within the server's limits. */
export function widened<View extends Intrinsics & Viewport>(view: View, overscan: number): View {
  const marginX = Math.round(view.width * overscan);
  const marginY = Math.round(view.height * overscan);
  const wide = {
    ...view,
    cx: view.cx + marginX,
    cy: view.cy + marginY,
    width: view.width + 2 * marginX,
    height: view.height + 2 * marginY,
  };
  const { width, height } = viewportFor(wide.width, wide.height);
  return resized(wide, width, height);
}

/** A camera's pose, with its lens in pixels of a viewport. */
export type Camera = ScenePose & Intrinsics & Viewport;

export interface Told {
  readonly pose: number;
  /** Time of the message on the page's clock. */
  readonly at: number;
  /** The camera and its lens, as the stage shows it. */
  readonly asked: Camera;
  /** Extent of the frames, margins included, in pixels of the session's viewport. */
  readonly view: Camera;
}

export interface CameraFeedOptions {
  readonly rig: Rig;
  readonly foresight: Foresight;
  /** Margin of the stream at each side; null if frames are shown without a warp. */
  readonly overscan: number | null;
}

export class CameraFeed {
  /** Number of messages remembered; frames follow theirs within a few messages. */
  static readonly KEPT = 1200;
  readonly #options: CameraFeedOptions;
  readonly #told = new Map<number, Told>();
  /** The stream's viewport; lenses for others are ignored. */
  readonly #viewport: Viewport;
  #lens: Intrinsics;
  /** The last message; null before the first. */
  #last: (Told & { readonly camera: ScenePose; readonly lens: Intrinsics }) | null = null;
  #number = 0;

  constructor(options: CameraFeedOptions) {
    this.#options = options;
    this.#viewport = options.rig.viewport.peek();
    this.#lens = options.rig.intrinsics.peek();
  }

  /** Opens a stream; returns its first view, which is message 0. */
  open(now: number): Camera {
    const { rig } = this.#options;
    this.#told.clear();
    this.#last = null;
    this.#number = 0;
    this.#followLens();
    const views = this.#views(rig.pose);
    this.#told.set(0, { pose: rig.pose.seq, at: now, ...views });
    return views.view;
  }

  /** Called once per animation frame: calls `send` if something changed, and returns whether it was sent. */
  follow(now: number, send: (update: PoseUpdate) => boolean): void {
    const { rig, foresight, overscan } = this.#options;
    const camera = foresight.pose(now);
    const pose = rig.pose.seq;
    this.#followLens();
    const last = this.#last;
    if (last && last.pose === pose && last.lens === this.#lens && samePose(last.camera, camera)) return;
    // One pose may be sent repeatedly with a different prediction or lens, and warping a frame requires its exact message.
    const number = overscan === null ? pose : this.#number + 1;
    const views = this.#views(camera);
    const { fx, fy, cx, cy } = views.view;
    if (!send({ ...camera, fx, fy, cx, cy, seq: number })) return;
    this.#number = number;
    this.#last = { pose, at: now, ...views, camera, lens: this.#lens };
    this.#told.set(number, this.#last);
    for (const old of this.#told.keys()) {
      if (this.#told.size <= CameraFeed.KEPT) break;
      this.#told.delete(old);
    }
  }

  /** The content of message `number`; undefined if it is unknown or too old. */
  told(number: number): Told | undefined {
    return this.#told.get(number);
  }

  #views({ position, quaternion }: ScenePose): Pick<Told, "asked" | "view"> {
    const asked = { position, quaternion, ...this.#viewport, ...this.#lens };
    return { asked, view: widened(asked, this.#options.overscan ?? 0) };
  }

  #followLens(): void {
    const { rig } = this.#options;
    if (rig.viewport.peek() === this.#viewport) this.#lens = rig.intrinsics.peek();
  }
}
