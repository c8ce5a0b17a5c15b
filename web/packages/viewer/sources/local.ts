/** The mode `local`: the scene is downloaded and rendered in this browser. */
import { signal } from "@preact/signals";
import { hostUrl } from "#client/transport/host-url";
import { LocalPlayer } from "../local/local-player";
import type { Source, SourceContext, SourceKind } from "./source";

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
  open: (context) => new Local(context),
};

class Local extends LocalPlayer implements Source {
  readonly enhancement = null;
  readonly content = null;
  readonly reprojection = signal("off" as const);

  constructor(context: SourceContext) {
    const { scene, config } = context;
    const present = scene.peek();
    if (present === null) throw new Error("there is no scene to download yet");
    const path = `scenes/${encodeURIComponent(present.id)}/download/compressed`;
    super({
      ...context,
      scene: present,
      url: () => hostUrl(path, config.peek() ?? {}),
      memory: (navigator as { readonly deviceMemory?: number }).deviceMemory,
    });
  }

  async status() {
    return null;
  }
}
