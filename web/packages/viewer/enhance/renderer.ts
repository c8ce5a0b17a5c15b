/**
 * Runs decoded pictures through the models and the resampler onto a canvas, without readback. A drawn frame keeps the
 * inputs of the last step until it is released, so that it can be copied without loss while newer ones are in progress.
 */
import type { Chain } from "./chain";
import { cover, type Size } from "./geometry";
import { EnhancementError, type Filter, firstLine } from "./model/enhancer";
import { MOST_FRAMES } from "./pace";
import { Resampler } from "./resampler";
import { Stopwatch } from "./stopwatch";

/** The input picture with its index in the ladder, null for a frame without a rung. */
export interface Picture extends Size {
  readonly rung: number | null;
}

/** A frame that was handed to the graphics processor. */
export interface Drawn extends Size {
  /** Resolves when it is done, to its duration in milliseconds. Rejects if the device was lost meanwhile. */
  readonly done: Promise<number>;
}

interface Slot {
  readonly across: GPUBuffer;
  readonly down: GPUBuffer;
  readonly stopwatch: Stopwatch | null;
  /** The picture after the first step. */
  middle: GPUTexture | null;
  filter: Filter;
  /** Whether nothing more is awaited from it. */
  done: boolean;
}

export class Renderer {
  readonly #device: GPUDevice;
  readonly #canvas: HTMLCanvasElement;
  readonly #context: GPUCanvasContext;
  readonly #copies = new OffscreenCanvas(1, 1);
  readonly #copyContext: GPUCanvasContext;
  readonly #resampler: Resampler;
  readonly #free: Slot[];
  readonly #slots = new WeakMap<Drawn, Slot>();
  #doneAt = 0;

  /** Throws an EnhancementError if WebGPU cannot draw here. */
  constructor(device: GPUDevice, canvas: HTMLCanvasElement) {
    this.#device = device;
    this.#canvas = canvas;
    this.#context = configured(canvas.getContext("webgpu") as GPUCanvasContext | null, device);
    this.#copyContext = configured(this.#copies.getContext("webgpu") as GPUCanvasContext | null, device);
    this.#resampler = new Resampler(device);
    this.#free = Array.from({ length: MOST_FRAMES }, () => ({
      across: this.#resampler.sampling(),
      down: this.#resampler.sampling(),
      stopwatch: Stopwatch.of(device),
      middle: null,
      filter: "bicubic",
      done: true,
    }));
  }

  /**
   * Compiles shaders for pictures of a size ahead of time. Rejects with an EnhancementError if they cannot be enhanced.
   */
  async warmUp(chain: Chain, { width, height, rung }: Picture): Promise<void> {
    this.#device.pushErrorScope("validation");
    let thrown: unknown;
    try {
      const encoder = this.#device.createCommandEncoder();
      chain.run(encoder, chain.input({ width, height }), rung);
      this.#device.queue.submit([encoder.finish()]);
    } catch (error) {
      thrown = error;
    }
    const invalid = await this.#device.popErrorScope();
    if (thrown !== undefined) throw thrown;
    if (invalid !== null) throw new EnhancementError(`${chain.label} failed: ${firstLine(invalid.message)}`);
    await this.#device.queue.onSubmittedWorkDone();
  }

  /** Draws a picture at its displayed size. The bitmap stays open. Throws an EnhancementError if a model does. */
  draw(bitmap: ImageBitmap, rung: number | null, chain: Chain, display: Size): Drawn {
    const slot = this.#free.pop();
    if (slot === undefined) throw new Error("too many frames are in progress");
    const { width, height } = this.#fitting(display);
    const begun = performance.now();
    try {
      const input = chain.input(bitmap);
      this.#device.queue.copyExternalImageToTexture({ source: bitmap }, { texture: input }, [
        bitmap.width,
        bitmap.height,
      ]);
      const encoder = this.#device.createCommandEncoder();
      slot.stopwatch?.start(encoder);
      const picture = chain.run(encoder, input, rung);
      this.#prepare(slot, picture, { width, height }, chain.filter);
      this.#resampler.encode(encoder, slot.filter, "across", picture, slot.across, middleOf(slot));
      if (this.#canvas.width !== width || this.#canvas.height !== height) {
        this.#canvas.width = width;
        this.#canvas.height = height;
      }
      const target = this.#context.getCurrentTexture();
      this.#resampler.encode(encoder, slot.filter, "down", middleOf(slot), slot.down, target, slot.stopwatch?.last);
      slot.stopwatch?.stop(encoder);
      this.#device.queue.submit([encoder.finish()]);
    } catch (error) {
      this.#free.push(slot);
      throw error;
    }
    const drawn = { width, height, done: this.#done(slot, begun) };
    this.#slots.set(drawn, slot);
    return drawn;
  }

  /** A lossless copy of a displayed frame. */
  copy(drawn: Drawn): ImageBitmap {
    const slot = this.#slots.get(drawn);
    if (slot === undefined) throw new Error("the frame was released");
    this.#copies.width = drawn.width;
    this.#copies.height = drawn.height;
    const encoder = this.#device.createCommandEncoder();
    const target = this.#copyContext.getCurrentTexture();
    this.#resampler.encode(encoder, slot.filter, "down", middleOf(slot), slot.down, target);
    this.#device.queue.submit([encoder.finish()]);
    return this.#copies.transferToImageBitmap();
  }

  /** Releases a frame, which can no longer be copied. */
  release(drawn: Drawn): void {
    const slot = this.#slots.get(drawn);
    if (slot === undefined) return;
    this.#slots.delete(drawn);
    if (slot.done) this.#free.push(slot);
    else void drawn.done.catch(() => undefined).then(() => this.#free.push(slot)); // its stopwatch has yet to be read
  }

  #prepare(slot: Slot, picture: GPUTexture, display: Size, filter: Filter): void {
    const { across, down } = cover(picture, display);
    this.#resampler.write(slot.across, across);
    this.#resampler.write(slot.down, down);
    slot.filter = filter;
    if (slot.middle?.width === display.width && slot.middle.height === picture.height) return;
    slot.middle?.destroy();
    slot.middle = this.#device.createTexture({
      label: "picture after the first step",
      size: [display.width, picture.height],
      format: "rgba16float",
      usage: GPUTextureUsage.TEXTURE_BINDING | GPUTextureUsage.RENDER_ATTACHMENT,
    });
  }

  async #done(slot: Slot, begun: number): Promise<number> {
    slot.done = false;
    try {
      await this.#device.queue.onSubmittedWorkDone();
      const ended = performance.now();
      // Frames are done one after the other: none starts before the previous one has ended.
      const waited = ended - Math.max(begun, this.#doneAt);
      this.#doneAt = ended;
      return (await slot.stopwatch?.read(ended - begun)) ?? waited;
    } finally {
      slot.done = true;
    }
  }

  #fitting({ width, height }: Size): Size {
    const most = this.#device.limits.maxTextureDimension2D;
    const scale = Math.min(1, most / Math.max(width, height));
    const pixels = (length: number) => Math.max(1, Math.round(length * scale));
    return { width: pixels(width), height: pixels(height) };
  }
}

function configured(context: GPUCanvasContext | null, device: GPUDevice): GPUCanvasContext {
  if (context === null) throw new EnhancementError("This browser cannot draw with WebGPU.");
  context.configure({ device, format: navigator.gpu.getPreferredCanvasFormat(), alphaMode: "opaque" });
  return context;
}

function middleOf({ middle }: Slot): GPUTexture {
  if (middle === null) throw new Error("nothing was drawn");
  return middle;
}
