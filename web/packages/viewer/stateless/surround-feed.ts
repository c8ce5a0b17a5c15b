/** Requests the sides of the surround in addition to the view, and hands their pictures to the warp. */

import type { Rung, SceneInfo } from "#client/wire/render";
import type { Reprojector } from "../reproject/reprojector";
import type { SideSettings } from "../state/settings";
import { type ScenePose, viewDistance } from "../view/camera";
import type { Rig } from "../view/rig";
import type { FramePipeline, ViewRequest } from "./pipeline";
import { Surround, type WantedSide } from "./surround";

export interface SurroundFeedOptions {
  readonly reprojector: Pick<Reprojector<unknown>, "working" | "content" | "surround" | "takeSide">;
  readonly rig: Rig;
  readonly settings: { peek(): Pick<SideSettings, "surround"> };
  readonly ladder: { peek(): readonly Rung[] };
  readonly onReceived: (bytes: number) => void;
}

export class SurroundFeed {
  readonly #options: SurroundFeedOptions;
  #scene: SceneInfo | undefined;
  #surround = new Surround(Number.POSITIVE_INFINITY, [0, -1, 0]);

  constructor(options: SurroundFeedOptions) {
    this.#options = options;
  }

  /**
   * Called once per animation frame after the view's request, while connected; `pose`: predicted camera at the time of
   * the answer, `throughput`: in bits per second.
   */
  tick(pipeline: FramePipeline, pose: ScenePose, throughput: number | null, now: number): void {
    const { reprojector, rig, settings, ladder } = this.#options;
    const { scene } = rig;
    if (!reprojector.working || !settings.peek().surround || scene === undefined) return;
    if (scene !== this.#scene) this.#surround = new Surround(viewDistance(scene), scene.up);
    this.#scene = scene;
    if (!pipeline.spare || reprojector.content === undefined) return; // the first view comes before everything else
    const idle = pipeline.inFlight === 0;
    const there = reprojector.surround;
    const wanted = this.#surround.next({ now, pose, there, idle, throughput, ladder: ladder.peek() });
    if (wanted) void this.#ask(pipeline, scene.id, wanted, throughput);
  }

  /** Whether sides that were never seen are fetched now, before a resting view is sharpened; `throughput`: in bits per second. */
  hurries(throughput: number | null): boolean {
    const { reprojector, rig, settings, ladder } = this.#options;
    const entered = rig.scene !== undefined && rig.scene === this.#scene;
    if (!reprojector.working || !settings.peek().surround || !entered) return false;
    return this.#surround.hurries({ there: reprojector.surround, throughput, ladder: ladder.peek() });
  }

  /** Resets for a new connection: outstanding requests will not be answered. */
  reset(): void {
    this.#scene = undefined;
  }

  async #ask(pipeline: FramePipeline, scene: string, { side, view, profile }: WantedSide, throughput: number | null) {
    const surround = this.#surround;
    const { position, quaternion, ...lens } = view;
    const { seq } = this.#options.rig.pose;
    try {
      const asked: ViewRequest = { scene, position: [...position], quaternion: [...quaternion], ...lens, profile };
      const { header, arrival, bitmap } = await pipeline.aside(asked);
      const { render, encode } = header.timing ?? { render: 0, encode: 0 };
      surround.came(side, arrival.bytes, render + encode, throughput);
      this.#options.onReceived(arrival.bytes);
      this.#options.reprojector.takeSide(bitmap, side, view, seq);
      bitmap.close();
    } catch {
      surround.failed(side); // failures of additional pictures are not reported
    }
  }
}
