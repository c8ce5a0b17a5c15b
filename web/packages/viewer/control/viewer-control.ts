/** Control of a visit by code: its camera, settings, pictures and events. */
import { computed, effect, type ReadonlySignal, untracked } from "@preact/signals";
import type { SceneInfo } from "#client/wire/render";
import { cameraPath, type Easing } from "../movement/camera-path";
import type { TimedPose } from "../movement/movement";
import type { ViewerSession } from "../session/session";
import { validSettings } from "../state/settings";
import type { ScenePose } from "../view/camera";
import type { Viewport } from "../view/intrinsics";
import type { Figures } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import { travel, travelTo } from "./journey";
import { screenshot } from "./screenshot";
import { exportVideo, type VideoOptions } from "./video-export";
import type { ViewerSettings } from "./viewer-settings";

/**
 * Why there is no picture: the server is away or full, the scene cannot be shown, or the mode is not available; `invalid`: an
 * attribute of the element is invalid.
 */
export type ViewerErrorCode = "lost" | "full" | "failed" | "unavailable" | "invalid";

export interface ViewerEvents {
  /** The scene can be shown, and the camera is in it. */
  readonly loaded: SceneInfo;
  /** A frame is on the screen. */
  readonly frame: PresentedFrame;
  /** Figures, several times a second. */
  readonly stats: Figures;
  readonly error: { readonly code: ViewerErrorCode; readonly message: string };
}

const FULL = "The server is full. The scene will open automatically as soon as there is room.";

export class ViewerControl {
  readonly #session: ViewerSession;
  readonly #stops = new Set<() => void>();
  readonly #end = new AbortController();
  /**
   * Why there is no picture; null if nothing is wrong.
   * @internal
   */
  readonly problem: ReadonlySignal<ViewerEvents["error"] | null> = computed(() => {
    const { phase, left } = this.#session;
    const missing = left.missing.value;
    if (missing !== null) return { code: "unavailable", message: `${missing}.` };
    const phases = [phase.value, left.source.value?.phase.value];
    for (const one of phases) {
      if (one?.kind === "full") return { code: "full", message: FULL };
      if (one?.kind === "lost" || one?.kind === "failed") return { code: one.kind, message: one.message };
    }
    return null;
  });
  /** Initial pose of the camera once the scene is loaded. */
  #start: ScenePose | null = null;

  /** @internal */
  constructor(session: ViewerSession) {
    this.#session = session;
    this.on("loaded", () => {
      if (this.#start) session.rig.place(this.#start);
    });
  }

  /** The camera's current pose in the scene's own frame, camera to world. */
  get camera(): ScenePose {
    const { position, quaternion } = this.#session.rig.pose;
    return { position: [...position], quaternion: [...quaternion] };
  }

  /** Moves the camera to a pose, upright; before the scene is loaded, sets its initial pose. */
  set camera(pose: ScenePose) {
    const { rig, scene } = this.#session;
    this.#start = pose;
    if (scene.peek() === null) return;
    if (rig.source.peek() !== null) rig.drive(null);
    rig.place(pose);
  }

  get settings(): ViewerSettings {
    return this.#session.state.settings.peek();
  }

  /** Changes settings; the others are kept. Throws if one is unknown or invalid. */
  set(settings: Partial<ViewerSettings>): void {
    this.#session.state.settings.value = validSettings({ ...this.settings, ...settings });
  }

  /** Moves the camera to the scene's start view. */
  reset(): void {
    const { rig } = this.#session;
    this.#start = null;
    if (rig.source.peek() !== null) rig.drive(null);
    rig.resetCamera();
  }

  /**
   * Moves the camera to a pose in `duration` milliseconds. Resolves to true on arrival, or to false when the user or another
   * call takes over the camera.
   */
  animate(to: ScenePose, options: { readonly duration?: number; readonly easing?: Easing } = {}): Promise<boolean> {
    return travelTo(this.#session, to, options);
  }

  /** Moves the camera along keyframes; with `loop`, repeatedly. Resolves like `animate`. */
  path(
    keyframes: readonly TimedPose[],
    { loop = false, easing = "linear" }: { readonly loop?: boolean; readonly easing?: Easing } = {},
  ): Promise<boolean> {
    return travel(this.#session, cameraPath(keyframes, { easing, closed: loop }), loop);
  }

  /** A copy of the screen; null before the first picture. */
  picture(): Promise<ImageBitmap> | null {
    const { source } = this.#session.left;
    return (source.peek()?.stats.peek().shown ?? 0) > 0 ? this.#session.left.picture() : null;
  }

  /** A PNG of the view at full quality, rendered by the server. Rejects with the reason in one sentence. */
  screenshot(size: Partial<Viewport> = {}): Promise<Blob> {
    return screenshot(this.#session, size, this.#end.signal);
  }

  /** A camera path as a video at full quality, which takes longer than the path. Rejects with the reason in one sentence. */
  video(
    keyframes: readonly TimedPose[],
    {
      easing = "linear",
      loop = false,
      signal = this.#end.signal,
      ...options
    }: VideoOptions & { readonly easing?: Easing; readonly loop?: boolean } = {},
  ): Promise<Blob> {
    const either = AbortSignal.any([signal, this.#end.signal]);
    return exportVideo(this.#session, cameraPath(keyframes, { easing, closed: loop }), { ...options, signal: either });
  }

  /** Subscribes; returns a function that unsubscribes. A scene or an error that is already known is reported at once. */
  on<Name extends keyof ViewerEvents>(name: Name, listener: (event: ViewerEvents[Name]) => void): () => void {
    const stop = this.#listen(name, listener as (event: never) => void);
    const stopOnce = () => {
      this.#stops.delete(stopOnce);
      stop();
    };
    this.#stops.add(stopOnce);
    return stopOnce;
  }

  /** Ends its movements and subscriptions, and cancels pictures and videos in progress. */
  destroy(): void {
    this.#end.abort(new Error("The viewer was closed."));
    this.#session.rig.drive(null);
    for (const stop of this.#stops) stop();
  }

  #listen(name: keyof ViewerEvents, tell: (event: never) => void): () => void {
    const say = tell as (event: ViewerEvents[keyof ViewerEvents]) => void;
    const { scene, left } = this.#session;
    switch (name) {
      case "loaded": {
        let entered = false;
        return effect(() => {
          const { value } = scene;
          if (value === null || entered) return;
          entered = true;
          untracked(() => say(value));
        });
      }
      case "frame":
        return this.#session.onPresented(say);
      case "stats":
        return effect(() => {
          const stats = left.source.value?.stats.value;
          if (stats) untracked(() => say(stats));
        });
      case "error":
        return effect(() => {
          const error = this.problem.value;
          if (error) untracked(() => say(error));
        });
    }
  }
}
