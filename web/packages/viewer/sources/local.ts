/** The mode `local`: the scene is downloaded and rendered in this browser. */
import type { SourceKind } from "./source";

export const LOCAL: SourceKind = {
  title: "Local",
  about: "The compressed scene is downloaded, the most important Gaussians first; this browser draws them.",
  settings: [],
  reopens: [],
  requests: false,
  drawsHere: true,
  keepsHidden: true,
  charts: false,
  missing: (_, { downloads }) => (downloads?.length ? null : "This server does not offer the scene for download"),
  load: async () => (await import("./local-source")).openLocal,
};
