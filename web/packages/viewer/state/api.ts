/** The service's JSON endpoints. Every failure is an ApiError with one sentence to show. */
import { ApiError, type AskOptions, ask } from "#client/http/problem";
import type { AddedScene, SceneEdit, SceneInfo, ServerConfig, Training } from "#client/wire/render";

const TIMEOUT = 5000;

/**
 * `viewer`: which scene is viewed, and how its host does, for the director of a cluster. `server`: where it is, if not
 * where the page is from.
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

/** All scenes; `scan` has the server look at its directory again first, however long it takes. */
export function fetchScenes({ scan = false } = {}): Promise<SceneInfo[]> {
  return scan ? call("scenes?scan=1", {}) : callSoon("scenes");
}

interface Loading {
  /** Where, in a cluster. */
  readonly host?: string | null;
  readonly server?: string;
  /** Wait no longer than until it can be shown coarsely: then its state is `loading`. */
  readonly coarse?: boolean;
}

/** Loads a scene, however long it takes. */
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

/** The renamed scene; its name is also its id. */
export function renameScene(id: string, name: string): Promise<SceneInfo> {
  const init = { method: "POST", body: JSON.stringify({ name }) };
  return callSoon(`scenes/${encodeURIComponent(id)}/rename`, init);
}

/** Changes a scene's start view, saved views and camera paths; the changed scene. */
export function editScene(id: string, edit: SceneEdit): Promise<SceneInfo> {
  const init = { method: "PATCH", body: JSON.stringify(edit) };
  return callSoon(`scenes/${encodeURIComponent(id)}`, init);
}

/** Makes the upload at this URL a scene, however long it takes to check it. */
export function addUploaded(url: string, signal?: AbortSignal): Promise<AddedScene> {
  return call(`${url}/scene`, { method: "POST", signal });
}

export function fetchScene(id: string, server = ""): Promise<SceneInfo> {
  return callSoon(at(server, `scenes/${encodeURIComponent(id)}`));
}

/** How far the training of a scene's networks is; `POST` begins it, and `DELETE` stops it. */
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
