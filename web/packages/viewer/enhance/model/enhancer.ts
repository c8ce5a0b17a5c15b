/**
 * Interface of a model of the enhancement stage. Each has its own file; `registry.ts` lists them and explains how to
 * add one.
 *
 * Pictures are textures with sRGB-coded red, green and blue, from 0 to 1; alpha is ignored. They are read as
 * `texture_2d<f32>`, by `textureLoad` or through a sampler.
 */
import type { Rung, SceneInfo } from "#client/wire/render";

/** In the order in which frames pass them. */
export const KINDS = ["restore", "upscale"] as const;
export type Kind = (typeof KINDS)[number];
/** Stands in for a name where no model is chosen. */
export const OFF = "off";
/** How a picture is scaled to its displayed size. */
export type Filter = "bicubic" | "lanczos";

/** The properties of a scene that models depend on. */
export type EnhancedScene = Pick<SceneInfo, "id" | "enhance">;

export interface Enhancer {
  /** Name in URLs, settings and experiments. */
  readonly name: string;
  /** Name on the page. */
  readonly label: string;
  readonly kind: Kind;
  /** Bicubic by default. */
  readonly filter?: Filter;
  /** Path of its weights at the server; null if the scene has none. Absent if it has no weights. */
  readonly weights?: (scene: EnhancedScene) => string | null;
  /**
   * Prepares everything independent of a picture's size. `weights` is the content of that file, or null. Rejects with an
   * `EnhancementError`, with a message for the user, if the weights are invalid, for example for another ladder.
   */
  readonly load: (device: GPUDevice, weights: ArrayBuffer | null, ladder: readonly Rung[]) => Promise<Loaded>;
}

export interface Loaded {
  /**
   * Encodes the work on one picture and returns the texture of the result: `input` itself if there is no work.
   *
   * Pictures of one size use the same texture, frame after frame, and sizes change with the ladder's rung while the
   * user walks: key pipelines and textures by `input`, in a `WeakMap`. The result must stay unchanged until the next
   * call, and may have any format that shaders can read as `texture_2d<f32>`. `rung` is the frame's index in the
   * ladder, null for a frame without a rung: the size does not determine it, since frames have the viewport's aspect
   * ratio.
   */
  run(encoder: GPUCommandEncoder, input: GPUTexture, rung: number | null): GPUTexture;
  /** Whether it changes frames of a rung; all frames by default. */
  readonly serves?: (rung: number) => boolean;
  /** Destroys its textures and buffers; no method is called afterwards. */
  dispose(): void;
}

/** Reason why a picture cannot be enhanced: one sentence for the user. */
export class EnhancementError extends Error {
  override readonly name = "EnhancementError";
}

/** First line of a GPU error message; the remainder is for the shader's author. */
export function firstLine(message: string): string {
  return message.trim().split("\n", 1)[0] ?? "";
}
