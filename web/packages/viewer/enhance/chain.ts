/** The chosen models, ready on a device; each picture passes through them in turn. */
import { readProblem } from "#client/http/problem";
import { hostUrl } from "#client/transport/host-report";
import type { Rung, ServerConfig } from "#client/wire/render";
import type { Size } from "./geometry";
import {
  type EnhancedScene,
  EnhancementError,
  type Enhancer,
  type Filter,
  type Kind,
  type Loaded,
  OFF,
} from "./model/enhancer";

/** The source of the frames. */
export interface Place {
  readonly scene: EnhancedScene;
  readonly ladder: readonly Rung[];
  /** The server of the scene's weights. */
  readonly host: Pick<ServerConfig, "host" | "render_url">;
}

interface Ready {
  readonly model: Enhancer;
  readonly loaded: Loaded;
}

/** Enough for a ladder's rungs in two aspect ratios of the window, and a few more. */
const MOST_SIZES = 12;

export class Chain {
  readonly label: string;
  /** Labels of the models that change frames, by rung; empty if none does. */
  readonly labels: readonly string[];
  /** Filter of the last step, which scales the picture to the displayed size. */
  readonly filter: Filter;
  readonly #device: GPUDevice;
  readonly #inputs = new Map<string, GPUTexture>();
  readonly #models: readonly Ready[];

  private constructor(device: GPUDevice, models: readonly Enhancer[], loaded: readonly Loaded[], { ladder }: Place) {
    this.label = joined(models);
    this.#device = device;
    this.filter = models.findLast(({ filter }) => filter !== undefined)?.filter ?? "bicubic";
    this.#models = models.flatMap((model, index) => (loaded[index] ? [{ model, loaded: loaded[index] }] : []));
    this.labels = ladder.map((_, rung) => joined(this.#serving(rung)));
  }

  /** Rejects with an EnhancementError, or with the reason of `signal`, after releasing everything loaded. */
  static async load(device: GPUDevice, models: readonly Enhancer[], place: Place, signal: AbortSignal): Promise<Chain> {
    const loading = await Promise.allSettled(models.map((model) => loadOne(device, model, place, signal)));
    const loaded = loading.flatMap((one) => (one.status === "fulfilled" ? one.value : []));
    const failed = loading.find((one) => one.status === "rejected");
    if (failed || signal.aborted) for (const one of loaded) one.dispose();
    signal.throwIfAborted();
    if (failed) throw failed.reason;
    return new Chain(device, models, loaded, place);
  }

  /** Names of the models that change frames of a rung, or `off`. */
  names(rung: number | null): Readonly<Record<Kind, string>> {
    const serving = this.#serving(rung);
    const nameOf = (kind: Kind) => serving.find((model) => model.kind === kind)?.name ?? OFF;
    return { restore: nameOf("restore"), upscale: nameOf("upscale") };
  }

  /** Input texture for decoded pictures of a size. */
  input({ width, height }: Size): GPUTexture {
    const key = `${width} ${height}`;
    const { TEXTURE_BINDING, COPY_DST, RENDER_ATTACHMENT } = GPUTextureUsage;
    const texture =
      this.#inputs.get(key) ??
      this.#device.createTexture({
        label: "decoded picture",
        size: [width, height],
        format: "rgba8unorm",
        usage: TEXTURE_BINDING | COPY_DST | RENDER_ATTACHMENT,
      });
    this.#inputs.set(key, texture);
    return texture;
  }

  /**
   * Whether it holds resources for so many sizes that it must be replaced: while a window is resized, each frame has a
   * different size.
   */
  get crowded(): boolean {
    return this.#inputs.size > MOST_SIZES;
  }

  /** Encodes all models' work. Throws an EnhancementError that names the failing model. */
  run(encoder: GPUCommandEncoder, input: GPUTexture, rung: number | null): GPUTexture {
    return this.#models.reduce((picture, { model, loaded }) => {
      try {
        return loaded.run(encoder, picture, rung);
      } catch (error) {
        throw new EnhancementError(`${model.label} failed: ${sentence(error)}`);
      }
    }, input);
  }

  #serving(rung: number | null): readonly Enhancer[] {
    const serves = ({ serves }: Loaded) => serves === undefined || (rung !== null && serves(rung));
    return this.#models.filter(({ loaded }) => serves(loaded)).map(({ model }) => model);
  }

  dispose(): void {
    for (const { loaded } of this.#models) loaded.dispose();
    for (const texture of this.#inputs.values()) texture.destroy();
  }
}

async function loadOne(
  device: GPUDevice,
  model: Enhancer,
  { scene, ladder, host }: Place,
  signal: AbortSignal,
): Promise<Loaded> {
  try {
    const url = model.weights?.(scene);
    if (url === null) throw new EnhancementError("there are no weights for this scene.");
    return await model.load(device, url === undefined ? null : await fetchWeights(hostUrl(url, host), signal), ladder);
  } catch (error) {
    signal.throwIfAborted();
    throw new EnhancementError(`${model.label} cannot be used: ${sentence(error)}`);
  }
}

async function fetchWeights(url: string, signal: AbortSignal): Promise<ArrayBuffer> {
  let response: Response;
  try {
    response = await fetch(url, { signal });
    if (response.ok) return await response.arrayBuffer();
  } catch {
    throw new EnhancementError("its weights could not be loaded.");
  }
  throw new EnhancementError(`its weights could not be loaded: ${(await readProblem(response)).detail}`);
}

function joined(models: readonly { readonly label: string }[]): string {
  return models.map(({ label }) => label).join(" + ");
}

function sentence(error: unknown): string {
  const said = error instanceof Error ? error.message : String(error);
  return /[.!?]$/.test(said) ? said : `${said}.`;
}
