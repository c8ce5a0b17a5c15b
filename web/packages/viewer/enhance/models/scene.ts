/**
 * Ours: small networks, one a rung, that were trained on views of the very scene, or on several scenes for one without its own.
 * `docs/experiments.md` describes them.
 */

import type { Enhancer } from "../model/enhancer";

export const SCENE: Enhancer = {
  name: "scene",
  label: "Scene-tuned network",
  kind: "upscale",
  weights: ({ id, enhance }) => {
    if (enhance === "scene") return `scenes/${encodeURIComponent(id)}/enhance.safetensors`;
    return enhance === "general" ? "enhance/general.safetensors" : null;
  },
  load: async (device, weights, ladder) =>
    (await import("../network/scene-network")).loadSceneNetworks(device, weights, ladder),
};
