/** The page named by the URL's hash, so that reloading, bookmarks and the back button work. */
import { LINKED } from "#viewer/state/settings";

export type Route =
  | { readonly page: "scenes" }
  | { readonly page: "experiments" }
  | { readonly page: "samples" | "run"; readonly experiment: string }
  | {
      readonly page: "viewer";
      readonly scene: string;
      readonly asked: Asked;
      /** Shows only the view, as in a frame of another page. */
      readonly bare?: true;
      /** Unknown names in the link. */
      readonly unknown?: readonly string[];
    };

/** Contents of a link as text: settings, and a pose (`link.ts`). Omitted settings keep their previous values. */
export type Asked = Readonly<Partial<Record<(typeof ASKABLE)[number], string>>>;

export const ASKABLE = ["at", "view", ...LINKED] as const;

/** The list of experiments. */
export const EXPERIMENTS = "#/experiments";
/** In a link: hides all controls of the page. */
const BARE = "noui";
/** `?at=x,y,z,qx,qy,qz,qw` is the camera pose; `?view=NAME` a saved view; `?mode=NAME`, `?reprojection=on|off` and so on are settings. */
const VIEWER = /^#\/scene\/([^/?]+)(?:\?(.*))?$/;

const EXPERIMENT = /^#\/experiments\/([^/?]+)\/(samples|run)$/;

export function parseRoute(hash: string): Route {
  if (hash === EXPERIMENTS) return { page: "experiments" };
  const [, id, query] = VIEWER.exec(hash) ?? [];
  const [, experiment, page] = EXPERIMENT.exec(hash) ?? [];
  try {
    if (experiment !== undefined) {
      return { page: page === "run" ? page : "samples", experiment: decodeURIComponent(experiment) };
    }
    if (id === undefined) return { page: "scenes" };
    const scene = decodeURIComponent(id);
    const parameters = new URLSearchParams(query);
    const asked = ASKABLE.flatMap((name) => (parameters.has(name) ? [[name, parameters.get(name) ?? ""]] : []));
    const known: readonly string[] = [...ASKABLE, BARE];
    const unknown = [...parameters.keys()].filter((name) => !known.includes(name));
    return {
      page: "viewer",
      scene,
      asked: Object.fromEntries(asked),
      ...(parameters.has(BARE) && { bare: true as const }),
      ...(unknown.length > 0 && { unknown }),
    };
  } catch {
    return { page: "scenes" }; // an invalid escape sequence
  }
}

export function sceneHash(scene: string): string {
  return `#/scene/${encodeURIComponent(scene)}`;
}

/** The page that makes an experiment's missing runs. */
export function runHash(experiment: string): string {
  return `${EXPERIMENTS}/${encodeURIComponent(experiment)}/run`;
}

/** The samples of an experiment in the store. */
export function samplesHash(experiment: string): string {
  return `${EXPERIMENTS}/${encodeURIComponent(experiment)}/samples`;
}
