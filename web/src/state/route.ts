/** Which page the URL's hash names, so that reloading, bookmarks and the back button work. */
import { LINKED } from "./settings";

export type Route =
  | { readonly page: "scenes" }
  | { readonly page: "experiments" }
  | { readonly page: "samples"; readonly experiment: string }
  | {
      readonly page: "viewer";
      readonly scene: string;
      readonly stamp: boolean;
      readonly asked: Asked;
      /** Names in the link that mean nothing here, if there are any. */
      readonly unknown?: readonly string[];
    };

/** What a link names, as text: settings, and a pose (`link.ts`). What it leaves out is as it was chosen before. */
export type Asked = Readonly<Partial<Record<(typeof ASKABLE)[number], string>>>;

export const ASKABLE = ["at", ...LINKED] as const;
export const STAMP = "stamp";

/** The list of experiments. */
export const EXPERIMENTS = "#/experiments";
/**
 * `?stamp` has each frame carry its pose's number, for tests that read from the screen what is shown; `?at=x,y,z,qx,qy,qz,qw` says
 * where the camera is, and `?mode=NAME`, `?reprojection=on|off` and so on what is chosen.
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
    const parameters = new URLSearchParams(query);
    const asked = ASKABLE.flatMap((name) => (parameters.has(name) ? [[name, parameters.get(name) ?? ""]] : []));
    const known: readonly string[] = [STAMP, ...ASKABLE];
    const unknown = [...parameters.keys()].filter((name) => !known.includes(name));
    const stamp = parameters.has(STAMP);
    return {
      page: "viewer",
      scene,
      stamp,
      asked: Object.fromEntries(asked),
      ...(unknown.length > 0 && { unknown }),
    };
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
