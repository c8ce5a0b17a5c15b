/** Which page the URL's hash names, so that reloading, bookmarks and the back button work. */

export type Route = { readonly page: "scenes" } | { readonly page: "viewer"; readonly scene: string };

const VIEWER = /^#\/scene\/([^/]+)$/;

export function parseRoute(hash: string): Route {
  const id = VIEWER.exec(hash)?.[1];
  if (id === undefined) return { page: "scenes" };
  try {
    return { page: "viewer", scene: decodeURIComponent(id) };
  } catch {
    return { page: "scenes" }; // a broken escape
  }
}

export function sceneHash(scene: string): string {
  return `#/scene/${encodeURIComponent(scene)}`;
}
