/** Which page the URL's hash names, so that reloading, bookmarks and the back button work. */

export type Route =
  | { readonly page: "scenes" }
  | { readonly page: "experiments" }
  | { readonly page: "viewer"; readonly scene: string; readonly stamp: boolean };

/** The list of experiments. */
export const EXPERIMENTS = "#/experiments";
/** `?stamp` has each frame carry its pose's number, for tests that read from the screen what is shown. */
const VIEWER = /^#\/scene\/([^/?]+)(\?stamp)?$/;

export function parseRoute(hash: string): Route {
  if (hash === EXPERIMENTS) return { page: "experiments" };
  const [, id, stamp] = VIEWER.exec(hash) ?? [];
  if (id === undefined) return { page: "scenes" };
  try {
    return { page: "viewer", scene: decodeURIComponent(id), stamp: stamp !== undefined };
  } catch {
    return { page: "scenes" }; // a broken escape
  }
}

export function sceneHash(scene: string): string {
  return `#/scene/${encodeURIComponent(scene)}`;
}
