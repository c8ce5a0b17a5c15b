/** A viewer in an element of any page, without controls: `const viewer = createViewer(element, { scene: "garden" })`. */
import { effect } from "@preact/signals";
import { ViewerControl } from "./control/viewer-control";
import type { ViewerSettings } from "./control/viewer-settings";
import { openStage } from "./embed/stage";
import { ViewerSession } from "./session/session";
import { validSettings } from "./state/settings";
import { ViewerState } from "./state/viewer-state";
import type { ScenePose } from "./view/camera";

export type { ViewerErrorCode, ViewerEvents } from "./control/viewer-control";
export type { ViewerSettings } from "./control/viewer-settings";
export type { Easing } from "./movement/camera-path";
export type { TimedPose } from "./movement/movement";
export type { ScenePose } from "./view/camera";

export interface ViewerOptions {
  /** The scene's id. */
  readonly scene: string;
  /** URL of the server; by default the page's own. */
  readonly server?: string;
  readonly settings?: Partial<ViewerSettings>;
  /** Initial pose of the camera; by default the scene's start view. */
  readonly camera?: ScenePose;
  /** Text for assistive technology. */
  readonly label?: string;
}

export class Viewer extends ViewerControl {
  readonly #close: () => void;

  constructor(container: HTMLElement, { scene, server = "", settings = {}, camera, label = scene }: ViewerOptions) {
    const state = new ViewerState({}, absolute(server));
    state.settings.value = validSettings({ ...state.settings.peek(), ...settings });
    const stage = openStage(container, label);
    const session = new ViewerSession(scene, stage, state);
    super(session);
    if (camera) this.camera = camera;
    const observer = new IntersectionObserver(([entry]) => {
      session.presence.away = entry?.isIntersecting === false;
    });
    observer.observe(stage.element);
    const stopMarking = effect(() => {
      stage.element.dataset.phase = session.phase.value.kind;
    });
    this.#close = () => {
      stopMarking();
      observer.disconnect();
      session.dispose();
      stage.close();
    };
  }

  /** Ends the connection and removes the viewer from its element. */
  override destroy(): void {
    super.destroy();
    this.#close();
  }
}

/** The URL without a trailing slash; empty for the page's own server. Throws if it is not a server's URL. */
function absolute(server: string): string {
  if (server === "") return server;
  const url = parsed(server);
  if (url === null || !/^https?:$/.test(url.protocol)) {
    throw new Error(`“${server}” is not a server's URL: use one such as https://viewer.example.`);
  }
  return url.href.replace(/\/+$/, "");
}

function parsed(url: string): URL | null {
  try {
    return new URL(url, document.baseURI);
  } catch {
    return null;
  }
}

/** Shows a scene in an element, which it fills, until it is destroyed. Throws if an option is invalid. */
export function createViewer(container: HTMLElement, options: ViewerOptions): Viewer {
  return new Viewer(container, options);
}
