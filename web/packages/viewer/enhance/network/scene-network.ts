/** A scene's networks on a device, one per rung. */
import type { Rung } from "#client/wire/render";
import { EnhancementError, type Loaded } from "../model/enhancer";
import { networksFor, readNetworks } from "./networks";
import { NetworkPipelines } from "./pipelines";

export async function loadSceneNetworks(
  device: GPUDevice,
  weights: ArrayBuffer | null,
  ladder: readonly Rung[],
): Promise<Loaded> {
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
