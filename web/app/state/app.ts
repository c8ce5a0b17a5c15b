/** State of the whole page: its route, the server's scenes, and the state of its viewer. */
import { effect, signal } from "@preact/signals";
import { ApiError } from "#client/http/problem";
import type { SceneInfo } from "#client/wire/render";
import { fetchConfig, fetchScenes, loadScene, unloadScene } from "#viewer/state/api";
import { loadSettings, saveSettings } from "#viewer/state/settings";
import { ViewerState } from "#viewer/state/viewer-state";
import { parseRoute, type Route } from "./route";

/** State of the viewer that fills the page. */
export const page = new ViewerState();
export const { settings, settingsOverridden, config, sceneLadder, ladder, change: changeSettings } = page;

export const route = signal<Route>({ page: "scenes" });
/** Null until the server has answered. */
export const scenes = signal<readonly SceneInfo[] | null>(null);
/** Reason why the list of scenes is missing or outdated, or null. */
export const scenesError = signal<string | null>(null);

/** Whether a video is being made, which would be lost if the page were closed. */
export const exporting = signal(false);

/** Whether the server has been updated and no longer has a part of this page. */
export const outdated = signal(false);

/** Connects the state to the browser; called once. */
export function start(): void {
  settings.value = loadSettings(() => localStorage);
  effect(() => {
    if (!settingsOverridden.value) saveSettings(() => localStorage, settings.value);
  });
  effect(() => {
    document.documentElement.dataset.theme = settings.value.theme;
  });
  const follow = () => {
    route.value = parseRoute(location.hash);
  };
  follow();
  addEventListener("hashchange", follow);
  addEventListener("vite:preloadError", () => {
    outdated.value = true;
  });
}

let refreshes = 0;

/**
 * Fetches the server's configuration and scenes; `scan` makes it rescan its directory.
 *
 * Returns the scenes, or null after a failure. Shows them unless a newer request is in progress.
 */
export async function refreshScenes({ scan = false } = {}): Promise<readonly SceneInfo[] | null> {
  const number = ++refreshes;
  try {
    const [newConfig, newScenes] = await Promise.all([fetchConfig(), fetchScenes({ scan })]);
    if (number === refreshes) {
      config.value = newConfig;
      scenes.value = newScenes;
      scenesError.value = null;
    }
    return newScenes;
  } catch (error) {
    if (number === refreshes) scenesError.value = sentence(error);
    return null;
  }
}

export async function setSceneLoaded(scene: SceneInfo, loaded: boolean): Promise<void> {
  if (loaded) replaceScene({ ...scene, state: "loading" });
  try {
    replaceScene(await (loaded ? loadScene(scene.id) : unloadScene(scene.id)));
    scenesError.value = null;
  } catch (error) {
    replaceScene(scene);
    await refreshScenes();
    scenesError.value = sentence(error);
  }
}

export function replaceScene(scene: SceneInfo): void {
  scenes.value = scenes.value?.map((other) => (other.id === scene.id ? scene : other)) ?? null;
}

function sentence(error: unknown): string {
  return error instanceof ApiError ? error.message : "Something went wrong. Try reloading the page.";
}
