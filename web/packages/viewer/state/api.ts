/** The service's JSON endpoints. Every failure is an ApiError with one sentence to show. */
import { ApiError, type AskOptions, ask } from "#client/http/problem";
import type { AddedScene, SceneEdit, SceneInfo, ServerConfig, Training } from "#client/wire/render";

const TIMEOUT = 5000;

/**
 * `viewer` reports the viewed scene and the state of its host to the director of a cluster. `server` is its URL, unless
 * the page is from there.
 */
export async function fetchConfig(
  signal?: AbortSignal,
  viewer: Readonly<Record<string, string>> = {},
  server = "",
): Promise<ServerConfig> {
  const query = new URLSearchParams(viewer).toString();
  const path = query === "" ? "config.json" : `config.json?${query}`;
  const config = await callSoon<ServerConfig | null>(at(server, path), { signal });
  if (!Array.isArray(config?.ladder)) throw new ApiError("The server's response could not be read.", true); // of a proxy
  return server === "" || config.render_url ? config : { ...config, render_url: server };
}

/** All scenes; `scan` makes the server rescan its directory first, without a time limit. */
export function fetchScenes({ scan = false } = {}): Promise<SceneInfo[]> {
  return scan ? call("scenes?scan=1", {}) : callSoon("scenes");
}

interface Loading {
  /** The host, in a cluster. */
  readonly host?: string | null;
  readonly server?: string;
  /** Wait only until it can be shown coarsely; its state is then `loading`. */
  readonly coarse?: boolean;
}

/** Loads a scene, without a time limit. */
export function loadScene(id: string, signal?: AbortSignal, { host, server = "", coarse }: Loading = {}) {
  const query = new URLSearchParams({ ...(coarse && { coarse: "1" }), ...(host && { host }) }).toString();
  const path = `scenes/${encodeURIComponent(id)}/load${query && `?${query}`}`;
  return call<SceneInfo>(at(server, path), { method: "POST", signal });
}

export function unloadScene(id: string): Promise<SceneInfo> {
  return callSoon(`scenes/${encodeURIComponent(id)}/unload`, { method: "POST" });
}

/** Deletes a scene on the server's disk. */
export function deleteScene(id: string): Promise<void> {
  return callSoon(`scenes/${encodeURIComponent(id)}`, { method: "DELETE" });
}

/** Renames a scene and returns it; its name is also its id. */
export function renameScene(id: string, name: string): Promise<SceneInfo> {
  const init = { method: "POST", body: JSON.stringify({ name }) };
  return callSoon(`scenes/${encodeURIComponent(id)}/rename`, init);
}

/** Changes a scene's start view, saved views and camera paths; returns the changed scene. */
export function editScene(id: string, edit: SceneEdit): Promise<SceneInfo> {
  const init = { method: "PATCH", body: JSON.stringify(edit) };
  return callSoon(`scenes/${encodeURIComponent(id)}`, init);
}

/** Turns the upload at this URL into a scene, without a time limit for checking it. */
export function addUploaded(url: string, signal?: AbortSignal): Promise<AddedScene> {
  return call(`${url}/scene`, { method: "POST", signal });
}

export function fetchScene(id: string, server = ""): Promise<SceneInfo> {
  return callSoon(at(server, `scenes/${encodeURIComponent(id)}`));
}

/** Progress of training a scene's networks; `POST` starts it, and `DELETE` stops it. */
export function training(id: string, method: "GET" | "POST" | "DELETE" = "GET"): Promise<Training> {
  return callSoon(`scenes/${encodeURIComponent(id)}/enhance`, { method });
}

/** The URL of a path at a server; relative to the page without one. */
const at = (server: string, path: string) => (server === "" ? path : `${server}/${path}`);

function call<T>(path: string, request: AskOptions): Promise<T> {
  const read = async (answer: Response) => (answer.status === 204 ? undefined : await answer.json());
  return ask(path, read, () => "The server is not responding.", request);
}

function callSoon<T>(path: string, request: AskOptions = {}): Promise<T> {
  return call(path, { ...request, timeout: TIMEOUT });
}
