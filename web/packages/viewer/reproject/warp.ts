/**
 * Late reprojection: shows the newest frame as seen from the current camera, on a WebGL2 canvas. If the view is that of
 * the frame, its pixels are shown unchanged; where the frame has no pixels, earlier views are used, or else the
 * surround; elsewhere the canvas is transparent.
 */

import type { DepthMap } from "#client/transport/transport";
import { drawsInSoftware } from "./acceleration";
import { CubeCache } from "./cube-cache";
import { GpuTimer } from "./gpu-timer";
import { Mesh } from "./mesh";
import { Program } from "./program";
import { COPY, EVERYWHERE } from "./shaders";
import { SidePictures } from "./side-pictures";
import { cropFor, resized, type View } from "./view";

export interface WarpOptions {
  /** Assumed distance of pixels without depth in scene units; Infinity rotates the frame only. */
  readonly distance: number;
  /** Requires graphics acceleration, since drawing in software freezes the page. */
  readonly accelerated?: boolean;
  /** Called when nothing can be drawn any more; the frame is lost. */
  readonly onLost?: () => void;
  /** Called when it works again and waits for a frame. */
  readonly onRestored?: () => void;
}

interface Resources {
  readonly frame: WebGLTexture;
  readonly copy: Program;
  readonly mesh: Mesh;
  readonly cache: CubeCache;
  readonly sides: SidePictures;
  readonly timer: GpuTimer;
}

/** Too slow, in milliseconds: half of a frame interval at 60 Hz. */
const SLOW = 8;
/** Opaque pictures have alpha as well; unseen directions are transparent. */
const CONTEXT: WebGLContextAttributes = { alpha: true, premultipliedAlpha: true, antialias: false, depth: true };

export class Warp {
  readonly #canvas: HTMLCanvasElement;
  readonly #options: WarpOptions;
  readonly #gl: WebGL2RenderingContext | null;
  #resources: Resources | null = null;
  /** Content of the texture; null without a frame. */
  #frame: View | null = null;
  /** Whether the frame is not in the cache yet. */
  #fresh = false;
  /** Whether the graphics processor is too slow for the sharpest picture. */
  #slow = false;

  /** Takes over the canvas. Never throws: see `working`. */
  constructor(canvas: HTMLCanvasElement, options: WarpOptions) {
    this.#canvas = canvas;
    this.#options = options;
    this.#gl = canvas.getContext("webgl2", {
      ...CONTEXT,
      failIfMajorPerformanceCaveat: options.accelerated === true,
    });
    canvas.addEventListener("webglcontextlost", this.#lost);
    canvas.addEventListener("webglcontextrestored", this.#restored);
    this.#build();
  }

  /** False without WebGL 2 or the requested acceleration, and after a lost context: calls then have no effect. */
  get working(): boolean {
    return this.#resources !== null;
  }

  /** Median GPU time of recent draws in milliseconds; null where it is not measured. */
  get gpuMs(): number | null {
    return this.#resources?.timer.ms ?? null;
  }

  /** Sets the newest picture, which is copied and may be closed by its owner. A video without a picture is ignored. */
  take(source: TexImageSource, view: View, depth: DepthMap | null): void {
    const { width, height } = sizeOf(source);
    if (this.#gl === null || this.#resources === null || width === 0 || height === 0) return;
    const gl = this.#gl;
    gl.bindTexture(gl.TEXTURE_2D, this.#resources.frame);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, source);
    this.#resources.mesh.bend(depth);
    this.#frame = resized(view, width, height);
    this.#fresh = true;
  }

  /** Adds a side of the surround, which is copied and replaces one of the same direction. */
  surround(source: TexImageSource, view: View): void {
    this.#resources?.sides.take(source, view);
  }

  /** Shows a view of the canvas's size; transparent before the first frame. */
  draw(view: View): void {
    const { width, height } = this.#canvas;
    if (this.#gl === null || this.#resources === null || width === 0 || height === 0) return;
    const { timer } = this.#resources;
    timer.begin();
    this.#slow ||= timer.ms !== null && timer.ms > SLOW;
    this.#draw(this.#gl, this.#resources, resized(view, width, height));
    timer.end();
  }

  forget(): void {
    this.#frame = null;
    this.#resources?.cache.clear();
    this.#resources?.sides.clear();
  }

  /** Frees everything; the canvas cannot be used afterwards. */
  dispose(): void {
    this.#canvas.removeEventListener("webglcontextlost", this.#lost);
    this.#canvas.removeEventListener("webglcontextrestored", this.#restored);
    this.#gl?.getExtension("WEBGL_lose_context")?.loseContext(); // browsers keep only a few
    this.#resources = null;
    this.#frame = null;
  }

  #draw(gl: WebGL2RenderingContext, { copy, mesh, cache, sides }: Resources, view: View): void {
    const frame = this.#frame;
    const { distance } = this.#options;
    if (frame && this.#fresh) cache.add(frame, distance);
    this.#fresh = false;
    gl.viewport(0, 0, view.width, view.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (frame === null) return;
    const crop = cropFor(frame, view, mesh.nearest(1 / distance));
    if (crop) {
      gl.disable(gl.DEPTH_TEST);
      copy.use();
      copy.integers("u_corner", crop.x, crop.y);
      copy.integer("u_height", view.height);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    } else {
      mesh.draw(frame, view, 1 / distance, this.#slow);
      sides.draw(view, distance);
      cache.draw(view);
    }
  }

  #build(): void {
    const gl = this.#gl;
    if (gl === null || gl.isContextLost() || (this.#options.accelerated && drawsInSoftware(gl))) return;
    try {
      gl.depthFunc(gl.LEQUAL);
      const frame = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, frame);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
      const copy = new Program(gl, EVERYWHERE, COPY);
      const around = { cache: new CubeCache(gl), sides: new SidePictures(gl) };
      this.#resources = { frame, copy, mesh: new Mesh(gl), ...around, timer: new GpuTimer(gl) };
    } catch {
      this.#resources = null; // a driver that refuses the shaders, or a processor that was lost meanwhile
    }
  }

  readonly #lost = (event: Event) => {
    event.preventDefault(); // otherwise it would never be restored
    this.#resources = null;
    this.#frame = null;
    this.#options.onLost?.();
  };

  readonly #restored = () => {
    this.#build();
    if (this.working) this.#options.onRestored?.();
  };
}

function sizeOf(source: TexImageSource): { readonly width: number; readonly height: number } {
  if ("videoWidth" in source) return { width: source.videoWidth, height: source.videoHeight };
  if ("displayWidth" in source) return { width: source.displayWidth, height: source.displayHeight };
  if ("naturalWidth" in source) return { width: source.naturalWidth, height: source.naturalHeight };
  return { width: source.width, height: source.height };
}
