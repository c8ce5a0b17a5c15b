/** Downloads the scene in the mode that draws it in this browser, and anew whenever what decides it changes. */
import { computed, effect, type ReadonlySignal, type Signal, untracked } from "@preact/signals";
import { type DownloadForm, type LocalOptions, LocalPlayer } from "../local/local-player";
import { config } from "../state/app";
import type { SideSettings } from "../state/sides";
import { hostUrl } from "../transport/host-url";
import type { SceneInfo } from "../wire/render";

/** What all downloads of a visit have in common. */
type Shared = Omit<LocalOptions, "scene" | "form" | "url" | "memory">;

/** `current` is what there is, or null, until the function that this returns is called. */
export function keepDownload(
  current: Signal<LocalPlayer | null>,
  scene: ReadonlySignal<SceneInfo | null>,
  settings: ReadonlySignal<SideSettings>,
  shared: Shared,
): () => void {
  const wanted = computed(() => {
    const { mode, localForm } = settings.value;
    return mode === "local" ? offeredForm(scene.value, localForm) : null;
  });
  return effect(() => {
    const form = wanted.value;
    const info = scene.peek();
    if (form === null || info === null) return undefined;
    const path = `scenes/${encodeURIComponent(info.id)}/download/${form}`;
    const url = () => hostUrl(path, config.peek() ?? {});
    const memory = (navigator as { readonly deviceMemory?: number }).deviceMemory;
    const local = untracked(() => new LocalPlayer({ ...shared, scene: info, form, url, memory }));
    current.value = local;
    return () => {
      current.value = null;
      local.dispose();
    };
  });
}

/** The form that was chosen, or another one where the scene is not offered in that; null if it is offered in none. */
export function offeredForm(scene: SceneInfo | null, chosen: DownloadForm): DownloadForm | null {
  const forms = scene?.downloads?.map(({ form }) => form) ?? [];
  return forms.find((form) => form === chosen) ?? forms[0] ?? null;
}
