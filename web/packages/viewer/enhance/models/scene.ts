/**
 * Ours: small networks, one a rung, that were trained on views of the very scene, or on several scenes for one without its own.
 * `docs/experiments.md` describes them.
 */

import type { Rung } from "#client/wire/render";
import { EnhancementError, type Enhancer, type Loaded } from "../model/enhancer";
import { networksFor, readNetworks } from "../network/networks";
import { NetworkPipelines } from "../network/pipelines";

export const SCENE: Enhancer = {
  name: "scene",
  label: "Scene-tuned network",
  kind: "upscale",
  scale: 2,
  weights: ({ id, enhance }) => {
    if (enhance === "scene") return `scenes/${encodeURIComponent(id)}/enhance.safetensors`;
    return enhance === "general" ? "enhance/general.safetensors" : null;
  },
  load,
};

async function load(device: GPUDevice, weights: ArrayBuffer | null, ladder: readonly Rung[]): Promise<Loaded> {
  if (weights === null) throw new EnhancementError("there are no weights for this scene.");
  const networks = readNetworks(weights);
  const chosen = networksFor(networks, ladder);
  const used = [...new Set(chosen.filter((network) => network !== undefined))];
  const compiled = await Promise.all(used.map((network) => NetworkPipelines.compile(device, network)));
  const byRung = chosen.map((network) => (network === undefined ? undefined : compiled[used.indexOf(network)]));
  return {
    run: (encoder, input, rung) => (rung === null ? undefined : byRung[rung])?.run(encoder, input) ?? input,
    serves: (rung) => byRung[rung] !== undefined,
    dispose: () => {
      for (const each of compiled) each.dispose();
    },
  };
}
