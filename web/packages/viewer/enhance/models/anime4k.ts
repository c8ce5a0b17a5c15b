/**
 * Anime4K's networks from the package `anime4k-webgpu`: trained on drawings, and included for comparison. The package, with all
 * weights (3.5 MB), is loaded when the first of them is switched on.
 */
import type * as Anime4K from "anime4k-webgpu";
import type { Enhancer, Kind, Loaded } from "../model/enhancer";

type PipelineOf = new (parts: Anime4K.Anime4KPipelineDescriptor) => Anime4K.Anime4KPipeline;
type Network = "CNNM" | "CNNVL" | "CNNUL" | "CNNx2M" | "CNNx2VL" | "CNNx2UL";

const model = (kind: Kind, size: string, network: Network): Enhancer => ({
  name: `anime4k-${kind}-${size.toLowerCase()}`,
  label: `Anime4K ${kind} ${size}`,
  kind,
  load: async (device) => new Anime4KModel(device, (await import("anime4k-webgpu"))[network]),
});

/** Three sizes of each kind; where both kinds are chosen, they form the chain of the paper's authors. */
export const ANIME4K: readonly Enhancer[] = [
  model("restore", "M", "CNNM"),
  model("restore", "VL", "CNNVL"),
  model("restore", "UL", "CNNUL"),
  model("upscale", "M", "CNNx2M"),
  model("upscale", "VL", "CNNx2VL"),
  model("upscale", "UL", "CNNx2UL"),
];

class Anime4KModel implements Loaded {
  readonly #network: PipelineOf;
  /** One per input texture. */
  readonly #pipelines = new Map<GPUTexture, Anime4K.Anime4KPipeline>();
  /** All textures made by the pipelines, because the package destroys none. */
  readonly #textures: GPUTexture[] = [];
  readonly #device: GPUDevice;

  constructor(device: GPUDevice, network: PipelineOf) {
    this.#network = network;
    this.#device = noting(device, this.#textures);
  }

  run(encoder: GPUCommandEncoder, input: GPUTexture): GPUTexture {
    const pipeline = this.#pipelines.get(input) ?? new this.#network({ device: this.#device, inputTexture: input });
    this.#pipelines.set(input, pipeline);
    pipeline.pass(encoder);
    return pipeline.getOutputTexture();
  }

  dispose(): void {
    this.#pipelines.clear();
    for (const texture of this.#textures.splice(0)) texture.destroy();
  }
}

/** A wrapper of the device that records its textures. */
function noting(device: GPUDevice, textures: GPUTexture[]): GPUDevice {
  const createTexture = (descriptor: GPUTextureDescriptor) => {
    const texture = device.createTexture(descriptor);
    textures.push(texture);
    return texture;
  };
  return new Proxy(device, {
    get: (_, name) => {
      if (name === "createTexture") return createTexture;
      const value = Reflect.get(device, name);
      return typeof value === "function" ? value.bind(device) : value;
    },
  });
}
