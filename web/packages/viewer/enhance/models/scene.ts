/**
 * Our own small networks, one per rung, trained on views of the scene itself, or on several scenes if it has no networks.
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
