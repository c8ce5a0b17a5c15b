/** Which page the URL's hash names, so that reloading, bookmarks and the back button work. */
import { KINDS, type Kind } from "../enhance/model/enhancer";

export type Route =
  | { readonly page: "scenes" }
  | { readonly page: "experiments" }
  | { readonly page: "samples"; readonly experiment: string }
  | { readonly page: "viewer"; readonly scene: string; readonly stamp: boolean; readonly models: Models };

/** Names of models that enhance frames; left out: as it was chosen before. */
export type Models = Readonly<Partial<Record<Kind, string>>>;

/** The list of experiments. */
export const EXPERIMENTS = "#/experiments";
/**
 * `?stamp` has each frame carry its pose's number, for tests that read from the screen what is shown; `?restore=NAME&upscale=NAME`
 * chooses the models that enhance frames.
 */
const VIEWER = /^#\/scene\/([^/?]+)(?:\?(.*))?$/;

const SAMPLES = /^#\/experiments\/([^/?]+)\/samples$/;

export function parseRoute(hash: string): Route {
  if (hash === EXPERIMENTS) return { page: "experiments" };
  const [, id, query] = VIEWER.exec(hash) ?? [];
  const [, experiment] = SAMPLES.exec(hash) ?? [];
  try {
    if (experiment !== undefined) return { page: "samples", experiment: decodeURIComponent(experiment) };
    if (id === undefined) return { page: "scenes" };
    const scene = decodeURIComponent(id);
    const asked = new URLSearchParams(query);
    const models = KINDS.flatMap((kind) => (asked.has(kind) ? [[kind, asked.get(kind) ?? ""]] : []));
    return { page: "viewer", scene, stamp: asked.has("stamp"), models: Object.fromEntries(models) };
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
