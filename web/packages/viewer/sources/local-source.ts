/** A downloaded scene as a source. */
import { signal } from "@preact/signals";
import { hostUrl } from "#client/transport/host-report";
import { LocalPlayer } from "../local/local-player";
import type { OpenSource, Source, SourceContext } from "./source";

export const openLocal: OpenSource = (context) => new Local(context);

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
}
