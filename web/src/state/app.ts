/** State shared by the whole page: settings, route, the server's configuration and its scenes. */

import { computed, effect, signal } from "@preact/signals";
import { ApiError } from "../http/problem";
import type { Rung, SceneInfo, ServerConfig } from "../wire/render";
import { fetchConfig, fetchScenes, loadScene, unloadScene } from "./api";
import { parseRoute, type Route } from "./route";
import { DEFAULT_SETTINGS, loadSettings, type Settings, saveSettings } from "./settings";

export const settings = signal<Settings>(DEFAULT_SETTINGS);
/** Settings of an experiment are not stored: reopening the page restores the user's own. */
export const settingsOverridden = signal(false);
export const route = signal<Route>({ page: "scenes" });
export const config = signal<ServerConfig | null>(null);
/** The own ladder of the scene that is visited, if it has one. */
export const sceneLadder = signal<readonly Rung[] | null>(null);
/**
 * The ladder that profiles index: the scene's own, or else the server's, best first; empty until the server has
 * answered.
 */
export const ladder = computed<readonly Rung[]>(() => sceneLadder.value ?? config.value?.ladder ?? []);
/** Null until the server has answered. */
export const scenes = signal<readonly SceneInfo[] | null>(null);
/** Why the list of scenes is missing or old, or null. */
export const scenesError = signal<string | null>(null);

/** A part of this page no longer exists on the server, which has been updated. */
export const outdated = signal(false);

export function changeSettings(part: Partial<Settings>): void {
  settings.value = { ...settings.value, ...part };
}

/** Connects the state with the browser; called once. */
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

/** Asks the server for its configuration and scenes; `scan` has it look at its directory again. */
export async function refreshScenes({ scan = false } = {}): Promise<void> {
  try {
    const [newConfig, newScenes] = await Promise.all([fetchConfig(), fetchScenes({ scan })]);
    config.value = newConfig;
    scenes.value = newScenes;
    scenesError.value = null;
  } catch (error) {
    scenesError.value = sentence(error);
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

/** Updates a scene in the list. */
export function replaceScene(scene: SceneInfo): void {
  scenes.value = scenes.value?.map((other) => (other.id === scene.id ? scene : other)) ?? null;
}

function sentence(error: unknown): string {
  return error instanceof ApiError ? error.message : "Something went wrong in this page; reloading it may help.";
}
