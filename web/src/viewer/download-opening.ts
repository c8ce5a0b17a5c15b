/** Downloads the scene for the mode that renders it in this browser, again whenever a relevant setting changes. */
import { computed, effect, type ReadonlySignal, type Signal, untracked } from "@preact/signals";
import { type LocalOptions, LocalPlayer } from "../local/local-player";
import { config } from "../state/app";
import type { SideSettings } from "../state/sides";
import { hostUrl } from "../transport/host-url";
import type { SceneInfo } from "../wire/render";

/** Parameters shared by all downloads of a visit. */
type Shared = Omit<LocalOptions, "scene" | "url" | "memory">;

/** `current` is the present download or null; returns a function that stops. */
export function keepDownload(
  current: Signal<LocalPlayer | null>,
  scene: ReadonlySignal<SceneInfo | null>,
  settings: ReadonlySignal<SideSettings>,
  shared: Shared,
): () => void {
  const wanted = computed(() => settings.value.mode === "local" && Boolean(scene.value?.downloads?.length));
  return effect(() => {
    const info = scene.peek();
    if (!wanted.value || info === null) return undefined;
    const path = `scenes/${encodeURIComponent(info.id)}/download/compressed`;
    const url = () => hostUrl(path, config.peek() ?? {});
    const memory = (navigator as { readonly deviceMemory?: number }).deviceMemory;
    const local = untracked(() => new LocalPlayer({ ...shared, scene: info, url, memory }));
    current.value = local;
    return () => {
      current.value = null;
      local.dispose();
    };
  });
}
