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
    const { scene, config, settings } = context;
    const present = scene.peek();
    if (present === null) throw new Error("there is no scene to download yet");
    const wanted = settings.peek().localForm;
    const form = present.downloads?.some((one) => one.form === wanted) ? wanted : "compressed";
    const name = form === "streamed" ? "streamed/lod-meta.json" : form;
    const path = `scenes/${encodeURIComponent(present.id)}/download/${name}`;
    super({
      ...context,
      scene: present,
      form,
      url: () => hostUrl(path, config.peek() ?? {}),
      memory: (navigator as { readonly deviceMemory?: number }).deviceMemory,
    });
  }
}
