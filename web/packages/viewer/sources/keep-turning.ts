/** Turns pictures as the settings have it. */
import { computed, effect, untracked } from "@preact/signals";
import { turning } from "../reproject/acceleration";
import type { Reprojector } from "../reproject/reprojector";
import { viewDistance } from "../view/camera";
import type { SourceContext } from "./source";

/** Returns a function that stops it. */
export function keepTurning(
  reprojector: Pick<Reprojector<unknown>, "on" | "off">,
  settings: SourceContext["settings"],
  scene: SourceContext["scene"],
): () => void {
  const distance = computed(() =>
    settings.value.reprojection && scene.value !== null ? viewDistance(scene.value) : null,
  );
  const loading = computed(() => scene.value?.state === "loading");
  const forced = computed(() => turning.value === "forced");
  return effect(() => {
    const { value } = distance;
    void forced.value; // starts again once it is requested
    void loading.value; // earlier pictures are coarse
    untracked(() => (value === null ? reprojector.off() : reprojector.on(value)));
  });
}
