/** Which page the URL's hash names, so that reloading, bookmarks and the back button work. */

export type Route =
  | { readonly page: "scenes" }
  | { readonly page: "experiments" }
  | { readonly page: "samples"; readonly experiment: string }
  | { readonly page: "viewer"; readonly scene: string; readonly stamp: boolean };

/** The list of experiments. */
export const EXPERIMENTS = "#/experiments";
/** `?stamp` has each frame carry its pose's number, for tests that read from the screen what is shown. */
const VIEWER = /^#\/scene\/([^/?]+)(\?stamp)?$/;

const SAMPLES = /^#\/experiments\/([^/?]+)\/samples$/;

export function parseRoute(hash: string): Route {
  if (hash === EXPERIMENTS) return { page: "experiments" };
  const [, id, stamp] = VIEWER.exec(hash) ?? [];
  const [, experiment] = SAMPLES.exec(hash) ?? [];
  try {
    if (experiment !== undefined) return { page: "samples", experiment: decodeURIComponent(experiment) };
    if (id === undefined) return { page: "scenes" };
    return { page: "viewer", scene: decodeURIComponent(id), stamp: stamp !== undefined };
  } catch {
    return { page: "scenes" }; // a broken escape
  }
}

export function sceneHash(scene: string): string {
  return `#/scene/${encodeURIComponent(scene)}`;
}

/** The samples of an experiment that the store keeps. */
export function samplesHash(experiment: string): string {
  return `${EXPERIMENTS}/${encodeURIComponent(experiment)}/samples`;
}
