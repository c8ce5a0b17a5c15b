/** A network on a device: its compute pipelines, and its textures for the sizes of incoming frames. */
import { EnhancementError } from "../model/enhancer";
import type { Network } from "./networks";
import { FORMAT, fasterPrecision, shaders } from "./wgsl";

interface Step {
  readonly pipeline: GPUComputePipeline;
  /** Pixels that a workgroup computes. */
  readonly tile: readonly [width: number, height: number];
}

/** Resources for the frames of one texture. */
interface Workspace {
  readonly input: GPUTexture;
  readonly steps: readonly (Step & { readonly bindings: GPUBindGroup })[];
  readonly activations: readonly GPUTexture[];
  readonly result: GPUTexture;
}

export class NetworkPipelines {
  readonly #device: GPUDevice;
  readonly #network: Network;
  readonly #steps: readonly Step[];
  #workspace: Workspace | undefined;

  private constructor(device: GPUDevice, network: Network, steps: readonly Step[]) {
    this.#device = device;
    this.#network = network;
    this.#steps = steps;
  }

  /** Compiles all layers at once, without blocking the page. Rejects with an EnhancementError if the device cannot. */
  static async compile(device: GPUDevice, network: Network): Promise<NetworkPipelines> {
    const steps = shaders(network, fasterPrecision(device)).map(async ({ code, tile }) => {
      const module = device.createShaderModule({ code });
      return { pipeline: await device.createComputePipelineAsync({ layout: "auto", compute: { module } }), tile };
    });
    try {
      return new NetworkPipelines(device, network, await Promise.all(steps));
    } catch (error) {
      throw new EnhancementError("this graphics processor cannot run it.", { cause: error });
    }
  }

  /** Encodes the network's work on a frame; the next frame's work overwrites the result. */
  run(encoder: GPUCommandEncoder, input: GPUTexture): GPUTexture {
    const { scale } = this.#network;
    if (scale * Math.max(input.width, input.height) > this.#device.limits.maxTextureDimension2D) return input;
    if (this.#workspace?.input !== input) {
      this.dispose();
      this.#workspace = this.#workspaceFor(input);
    }
    const { steps, result } = this.#workspace;
    const pass = encoder.beginComputePass();
    for (const { pipeline, tile, bindings } of steps) {
      pass.setPipeline(pipeline);
      pass.setBindGroup(0, bindings);
      pass.dispatchWorkgroups(Math.ceil(input.width / tile[0]), Math.ceil(input.height / tile[1]));
    }
    pass.end();
    return result;
  }

  /** Destroys the textures; the next frame makes new ones. */
  dispose(): void {
    for (const texture of this.#workspace?.activations ?? []) texture.destroy();
    this.#workspace?.result.destroy();
    this.#workspace = undefined;
  }

  #workspaceFor(input: GPUTexture): Workspace {
    const { scale, layers } = this.#network;
    const { width, height } = input;
    const channels = layers[0]?.outputs ?? 0;
    // A layer reads one of them and writes the other.
    const activations = [this.#texture([width, height, channels / 4]), this.#texture([width, height, channels / 4])];
    const result = this.#texture([scale * width, scale * height], GPUTextureUsage.COPY_SRC);
    const targets = activations.map((texture) => texture.createView({ dimension: "2d-array" }));
    let source = input.createView();
    const steps = this.#steps.map((step, i) => {
      const last = i === this.#steps.length - 1;
      const target = (last ? undefined : targets[i % 2]) ?? result.createView();
      const resources = last ? [source, target, input.createView()] : [source, target];
      source = target;
      const entries = resources.map((resource, binding) => ({ binding, resource }));
      const bindings = this.#device.createBindGroup({ layout: step.pipeline.getBindGroupLayout(0), entries });
      return { ...step, bindings };
    });
    return { input, steps, activations, result };
  }

  #texture(size: number[], usage = 0): GPUTexture {
    return this.#device.createTexture({
      size,
      format: FORMAT,
      usage: usage | GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.STORAGE_BINDING,
    });
  }
}
