/**
 * What a model of the enhancement stage is. Each has a file of its own; `registry.ts` lists them and says how to add one.
 *
 * Pictures are textures whose red, green and blue are sRGB-coded, from 0 to 1; alpha means nothing. They are read as
 * `texture_2d<f32>`, by `textureLoad` or through a sampler.
 */
import type { Rung, SceneInfo } from "../../wire/render";

/** In the order in which frames pass them. */
export const KINDS = ["restore", "upscale"] as const;
export type Kind = (typeof KINDS)[number];
/** In place of a name, where no model is chosen. */
export const OFF = "off";
/** How a picture is brought to the size at which it is displayed. */
export type Filter = "bicubic" | "lanczos";

export interface Enhancer {
  /** In URLs, settings and experiments. */
  readonly name: string;
  /** For people. */
  readonly label: string;
  readonly kind: Kind;
  /** Pixels that it makes of one, along each side; a model may leave pictures of some sizes as they are. */
  readonly scale: number;
  /** Bicubic if it does not say. */
  readonly filter?: Filter;
  /** The URL of its weights, relative to the page; null if there are none for this scene. Left out: it needs none. */
  readonly weights?: (scene: SceneInfo) => string | null;
  /**
   * Makes ready whatever does not depend on a picture's size. `weights` is the content of the URL, null where there is none to
   * load. Rejects with an `EnhancementError`, whose message a person reads, if the weights are not what they should be, such as
   * for another ladder than the server's.
   */
  readonly load: (device: GPUDevice, weights: ArrayBuffer | null, ladder: readonly Rung[]) => Promise<Loaded>;
}

/** A model on a device. */
export interface Loaded {
  /**
   * Encodes the work on one picture and returns the texture that will have the result: `input` itself where there is nothing to do.
   *
   * Pictures of one size come in the same texture, frame after frame, and sizes change with the ladder's rung while a person
   * walks: keep pipelines and textures by `input`, in a `WeakMap`. The result must stay as it is until the next call, and
   * may have any format that shaders can read as `texture_2d<f32>`. `rung` is the frame's place in the ladder, null for one of no
   * rung: the size does not tell it, since a rung's frames have the shape of the viewport.
   */
  run(encoder: GPUCommandEncoder, input: GPUTexture, rung: number | null): GPUTexture;
  /** Whether it changes frames of a rung; those of all if left out. */
  readonly serves?: (rung: number) => boolean;
  /** Destroys its textures and buffers; nothing is called afterwards. */
  dispose(): void;
}

/** Why a picture cannot be enhanced: one sentence for a person. */
export class EnhancementError extends Error {
  override readonly name = "EnhancementError";
}

/** What a graphics processor's message says first; the rest is for whoever wrote the shader. */
export function firstLine(message: string): string {
  return message.trim().split("\n", 1)[0] ?? "";
}
