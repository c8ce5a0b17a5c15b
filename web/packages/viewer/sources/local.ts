/** The mode `local`: the scene is downloaded and rendered in this browser. */
import type { SourceKind } from "./source";

export const LOCAL: SourceKind = {
  title: "Local",
  about: "This browser draws the scene itself: all of it, or just the levels of detail that the view needs.",
  settings: ["localForm"],
  reopens: ["localForm"],
  requests: false,
  drawsHere: true,
  keepsHidden: true,
  charts: false,
  missing: (_, { downloads }) => (downloads?.length ? null : "This server does not offer the scene for download"),
  load: async () => (await import("./local-source")).openLocal,
};
