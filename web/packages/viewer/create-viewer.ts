/** A viewer in an element of any page, without controls: `const viewer = createViewer(element, { scene: "garden" })`. */
import { effect, untracked } from "@preact/signals";
import type { SceneInfo } from "#client/wire/render";
import { openStage } from "./embed/stage";
import { ViewerSession } from "./session/session";
import type { Settings } from "./state/settings";
import { validSettings } from "./state/settings";
import { ViewerState } from "./state/viewer-state";
import type { ScenePose } from "./view/camera";
import type { Figures } from "./view/meter";
import type { PresentedFrame } from "./view/presented";

export interface ViewerOptions {
  /** The scene's id. */
  readonly scene: string;
  /** URL of the server; by default the page's own. */
  readonly server?: string;
  readonly settings?: Partial<Settings>;
  /** Where the camera begins; by default the scene's start view. */
  readonly camera?: ScenePose;
  /** Text for assistive technology. */
  readonly label?: string;
}

/**
 * Why there is no picture: the server is away or full, the scene cannot be shown, or the mode is not available; `invalid`: an
 * attribute of the element makes no sense.
 */
export type ViewerErrorCode = "lost" | "full" | "failed" | "unavailable" | "invalid";

export interface ViewerEvents {
  /** The scene is there, and the camera in it. */
  readonly loaded: SceneInfo;
  /** A frame is on the screen. */
  readonly frame: PresentedFrame;
  /** Figures, several times a second. */
  readonly stats: Figures;
  readonly error: { readonly code: ViewerErrorCode; readonly message: string };
}

const FULL = "The server is full. The scene opens automatically as soon as there is room.";

export class Viewer {
  readonly #session: ViewerSession;
  readonly #close: () => void;
  /** Where the camera begins once the scene is loaded. */
  #start: ScenePose | null = null;
  readonly #stops = new Set<() => void>();

  constructor(container: HTMLElement, { scene, server = "", settings = {}, camera, label = scene }: ViewerOptions) {
    const state = new ViewerState({}, server.replace(/\/+$/, ""));
    state.settings.value = validSettings({ ...state.settings.peek(), ...settings });
    const stage = openStage(container, label);
    this.#session = new ViewerSession(scene, stage, state);
    const stopMarking = effect(() => {
      stage.element.dataset.phase = this.#session.phase.value.kind;
    });
    this.#close = () => {
      stopMarking();
      this.#session.dispose();
      stage.close();
    };
    if (camera) this.look(camera);
    this.on("loaded", () => {
      if (this.#start) this.look(this.#start);
    });
  }

  /** The camera's present pose in the scene's own frame. */
  get camera(): ScenePose {
    const { position, quaternion } = this.#session.rig.pose;
    return { position: [...position], quaternion: [...quaternion] };
  }

  get settings(): Settings {
    return this.#session.state.settings.peek();
  }

  /** Puts the camera at a pose of the scene, upright. */
  look(pose: ScenePose): void {
    if (this.#session.scene.peek() === null) this.#start = pose;
    else this.#session.rig.place(pose);
  }

  /** Puts the camera at the scene's start view. */
  reset(): void {
    this.#session.rig.resetCamera();
  }

  /** Follows a path: the pose at a time (performance.now) until it is null. Null gives the camera back. */
  follow(path: ((now: number) => ScenePose | null) | null): void {
    this.#session.rig.drive(path);
  }

  /** Changes settings; the rest stays. Throws if one does not exist or make sense. */
  set(settings: Partial<Settings>): void {
    this.#session.state.settings.value = validSettings({ ...this.settings, ...settings });
  }

  /** A copy of the screen; null before the first picture. */
  picture(): Promise<ImageBitmap> | null {
    return this.#session.left.picture();
  }

  /** Subscribes; returns a function that unsubscribes. What is the case already is told at once. */
  on<Name extends keyof ViewerEvents>(name: Name, listener: (event: ViewerEvents[Name]) => void): () => void {
    const stop = this.#listen(name, listener as (event: never) => void);
    const stopOnce = () => {
      this.#stops.delete(stopOnce);
      stop();
    };
    this.#stops.add(stopOnce);
    return stopOnce;
  }

  destroy(): void {
    for (const stop of this.#stops) stop();
    this.#close();
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
          const error = this.#error();
          if (error) untracked(() => say(error));
        });
    }
  }

  #error(): ViewerEvents["error"] | null {
    const { phase, left } = this.#session;
    const missing = left.missing.value;
    if (missing !== null) return { code: "unavailable", message: `${missing}.` };
    const phases = [phase.value, left.source.value?.phase.value];
    for (const one of phases) {
      if (one?.kind === "full") return { code: "full", message: FULL };
      if (one?.kind === "lost" || one?.kind === "failed") return { code: one.kind, message: one.message };
    }
    return null;
  }
}

/** Shows a scene in an element, which it fills, until it is destroyed. */
export function createViewer(container: HTMLElement, options: ViewerOptions): Viewer {
  return new Viewer(container, options);
}
