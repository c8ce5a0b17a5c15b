/**
 * The networks of a file of weights: one for each rung in the training, with the architecture "tigas-sr-1" described in
 * docs/experiments.md. Strict: a file is valid as a whole or refused in one sentence. Pure.
 */

import * as v from "valibot";
import type { Rung } from "#client/wire/render";
import { EnhancementError } from "../model/enhancer";
import { quoted, readSafetensors, type Safetensors, type Tensor } from "./safetensors";

const ARCHITECTURE = "tigas-sr-1";

const integer = (low: number, high: number) => v.pipe(v.number(), v.integer(), v.minValue(low), v.maxValue(high));
const Descriptions = v.pipe(
  v.array(
    v.object({
      rung: integer(1, 15),
      width: integer(1, 8192),
      height: integer(1, 8192),
      quality: integer(1, 100),
      scale: v.picklist([1, 2]),
      layers: integer(2, 8),
      channels: v.pipe(integer(4, 32), v.multipleOf(4)),
    }),
  ),
  v.minLength(1),
  v.maxLength(16),
);
type Description = v.InferOutput<typeof Descriptions>[number];

/** A convolution of 3×3 pixels; its numbers are half-precision, as in Tensor. */
export interface Layer {
  readonly inputs: number;
  readonly outputs: number;
  /** [outputs, inputs, 3, 3] */
  readonly weights: Uint16Array;
  /** [outputs] */
  readonly bias: Uint16Array;
}

export interface Network {
  /** The rung that it was trained for, in the ladder at that time. */
  readonly rung: number;
  /** Pixels and JPEG quality of that rung. */
  readonly width: number;
  readonly height: number;
  readonly quality: number;
  /** Scale factor of width and height. */
  readonly scale: 1 | 2;
  readonly layers: readonly Layer[];
}

/** The networks in a file of weights. Throws EnhancementError. */
export function readNetworks(file: ArrayBuffer): Network[] {
  const safetensors = readSafetensors(file);
  const { architecture = "" } = safetensors.metadata;
  if (architecture !== ARCHITECTURE) {
    throw new EnhancementError(`its weights are for a network that this page does not know: ${quoted(architecture)}.`);
  }
  const left = new Map(safetensors.tensors);
  const networks = descriptions(safetensors).map((description) => network(description, left));
  const [spare] = left.keys();
  if (spare !== undefined) throw new EnhancementError(`its weights contain an unused tensor: ${quoted(spare)}.`);
  return networks;
}

function descriptions({ metadata }: Safetensors): Description[] {
  let networks: Description[];
  try {
    networks = v.parse(Descriptions, JSON.parse(metadata.networks ?? ""));
  } catch {
    throw new EnhancementError("its list of networks is not valid.");
  }
  const rungs = networks.map(({ rung }) => rung);
  if (new Set(rungs).size < rungs.length) throw new EnhancementError("its weights list a rung twice.");
  return networks;
}

/** Reads a network, removing its tensors from `tensors`. */
function network(description: Description, tensors: Map<string, Tensor>): Network {
  const { rung, scale, layers, channels } = description;
  return {
    ...description,
    layers: Array.from({ length: layers }, (_, i) => {
      const inputs = i === 0 ? 3 : channels;
      const outputs = i === layers - 1 ? 3 * scale ** 2 : channels;
      const name = `rung${rung}.conv${i}`;
      const weights = take(tensors, `${name}.weight`, [outputs, inputs, 3, 3]);
      return { inputs, outputs, weights, bias: take(tensors, `${name}.bias`, [outputs]) };
    }),
  };
}

function take(tensors: Map<string, Tensor>, name: string, shape: readonly number[]): Uint16Array {
  const tensor = tensors.get(name);
  if (tensor === undefined) throw new EnhancementError(`its weights lack the tensor ${name}.`);
  if (tensor.shape.join() !== shape.join()) {
    throw new EnhancementError(
      `its weights' tensor ${name} is of shape [${tensor.shape.slice(0, 8)}], not [${shape}].`,
    );
  }
  tensors.delete(name);
  return tensor.halves;
}

/** A network serves rungs up to this multiple of its own rung's height, and down to the inverse. */
const NEAR = 1.25;

/**
 * For each rung of a ladder, the network trained for the nearest height or, of two such, for the nearer quality; none if no height
 * is near. Throws EnhancementError if no rung has a network.
 */
export function networksFor(networks: readonly Network[], ladder: readonly Rung[]): (Network | undefined)[] {
  const found = ladder.map((rung) => nearest(networks, rung));
  if (found.every((network) => network === undefined)) {
    throw new EnhancementError("its weights were trained for other frame sizes than this ladder's.");
  }
  return found;
}

function nearest(networks: readonly Network[], { height, quality }: Rung): Network | undefined {
  const away = (network: Network) => Math.abs(Math.log(network.height / height));
  return networks
    .filter((network) => network.height <= NEAR * height && height <= NEAR * network.height)
    .sort((a, b) => away(a) - away(b) || Math.abs(a.quality - quality) - Math.abs(b.quality - quality))[0];
}
