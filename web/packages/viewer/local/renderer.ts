/**
 * Draws Gaussians in this browser, with PlayCanvas, with the same camera and colours as the server's pictures. Large, so it is loaded
 * only when it is needed.
 */
import {
  AppBase,
  AppOptions,
  Asset,
  CameraComponentSystem,
  Color,
  createGraphicsDevice,
  DEVICETYPE_WEBGL2,
  DEVICETYPE_WEBGPU,
  Entity,
  GAMMA_SRGB,
  type GraphicsDevice,
  GSplatComponentSystem,
  GSplatHandler,
  type Mat4,
  TextureHandler,
  TONEMAP_NONE,
} from "playcanvas";
import type { Size } from "../enhance/geometry";
import type { ScenePose } from "../view/camera";
import type { Intrinsics, Viewport } from "../view/intrinsics";
import { multiply } from "../view/vector";

export type Lens = Intrinsics & Viewport;

export interface RendererOptions {
  readonly canvas: HTMLCanvasElement;
  /** Background of the scene: sRGB, 0 to 1. */
  readonly background: readonly [number, number, number];
  /** Whether splats widened to a pixel are dimmed accordingly (Mip-Splatting's 2D filter). */
  readonly antialiased: boolean;
  /** Called when the GPU device is lost, which ends rendering. */
  readonly onLost: () => void;
}

export interface View {
  readonly pose: ScenePose;
  readonly lens: Lens;
  readonly size: Size;
  /** Time in milliseconds. */
  readonly now: number;
  /** Renders even without changes. */
  readonly again?: boolean;
}

/** Clipping distances in scene units: the rasteriser's, and one beyond any scene. */
const NEAR = 0.01;
const FAR = 10_000;
/** Degrees of rotation after which view-dependent colours are recomputed; PlayCanvas' default is 10. */
const COLOUR_ANGLE = 2;
/** Levels of detail that may be missing while better ones load; with fewer, PlayCanvas would show nothing. */
const ANY_LEVEL = 64;
/** The most Gaussians of a streamed scene that are drawn: PlayCanvas' default. */
const BUDGET = 1_000_000;
/** A budget for which only the coarsest level is loaded. With more, the next level would load at the same time. */
const COARSEST = 1;
/** Retries of a file, at growing intervals: 17 seconds in total, enough for a service to restart. */
const RETRIES = 7;
/** Bytes copied at a time. */
const COPIED = 1 << 20;
/** A half turn about x: from a camera that looks along z with y down (ours) to one that looks along -z with y up. */
const FLIPPED = [1, 0, 0, 0] as const;

export async function createRenderer(options: RendererOptions): Promise<Renderer> {
  const device = await createGraphicsDevice(options.canvas, {
    deviceTypes: [DEVICETYPE_WEBGPU, DEVICETYPE_WEBGL2],
    antialias: false,
    alpha: false,
    stencil: false,
    powerPreference: "high-performance",
  }).catch(() => {
    throw Object.assign(new Error("This browser supports neither WebGPU nor WebGL 2."), { name: "NoGraphics" });
  });
  return new Renderer(device, options);
}

export class Renderer {
  readonly backend: "WebGPU" | "WebGL 2";
  readonly #canvas: HTMLCanvasElement;
  readonly #app: AppBase;
  readonly #camera: Entity;
  readonly #scene: Entity;
  #asset: Asset | null = null;
  /** Number of scenes shown so far. */
  #shown = 0;
  #projection: number[] = [];
  #aim: readonly number[] = [];
  /** Called once the newest scene is in the picture. */
  #pending: (() => void) | null = null;
  #streamed = false;
  /** Files of a streamed scene that the view still needs: now, and the maximum. */
  #waiting = 0;
  #mostWaiting = 0;
  /** Whether the coarsest level of a streamed scene is in the picture, so that better ones may load. */
  #refining = false;
  /** Whether the picture shows a different scene from the last one reported. */
  #changed = false;
  /** Whether a scene is in the picture. */
  #visible = false;

  constructor(device: GraphicsDevice, { canvas, background, antialiased, onLost }: RendererOptions) {
    this.#canvas = canvas;
    this.backend = device.isWebGPU ? "WebGPU" : "WebGL 2";
    device.maxPixelRatio = 1; // the size is in the screen's pixels
    const setup = new AppOptions();
    setup.graphicsDevice = device;
    setup.componentSystems = [CameraComponentSystem, GSplatComponentSystem];
    setup.resourceHandlers = [GSplatHandler, TextureHandler];
    this.#app = new AppBase(canvas);
    this.#app.init(setup);
    this.#app.loader.enableRetry(RETRIES);
    this.#app.autoRender = false;
    const gsplat = this.#app.scene.gsplat;
    gsplat.minPixelSize = 0; // small Gaussians are drawn, as by the server
    gsplat.antiAlias = antialiased;
    gsplat.colorUpdateAngle = COLOUR_ANGLE;
    gsplat.lodUnderfillLimit = ANY_LEVEL;
    this.#camera = new Entity("camera", this.#app);
    this.#scene = new Entity("scene", this.#app);
    this.#app.root.addChild(this.#camera);
    this.#app.root.addChild(this.#scene);
    this.#camera.addComponent("camera", {
      clearColor: new Color(...background, 1),
      nearClip: NEAR,
      farClip: FAR,
      gammaCorrection: GAMMA_SRGB,
      toneMapping: TONEMAP_NONE,
      calculateProjection: (matrix: Mat4) => matrix.set(this.#projection),
    });
    this.#scene.addComponent("gsplat", {});
    // A frame rendered before its splats were sorted is rendered again afterwards.
    this.#app.systems.gsplat?.on("frame:request", () => {
      this.#app.renderNextFrame = true;
    });
    this.#app.systems.gsplat?.on("frame:ready", (_camera: unknown, _layer: unknown, ready: boolean, waiting: number) =>
      this.#frameReady(ready, waiting),
    );
    device.on("devicelost", onLost);
    this.#app.start();
    cancelAnimationFrame(this.#app.frameRequestId); // it renders on request
  }

  /**
   * Replaces the Gaussians by parts of a PLY file. Resolves when they are in the picture; throws if they cannot be
   * loaded.
   */
  async show(parts: readonly Uint8Array<ArrayBuffer>[]): Promise<void> {
    // PlayCanvas caches loaded assets by URL.
    const name = `scene-${++this.#shown}.ply`;
    const before = this.#asset;
    await this.#enter({ url: name, filename: name, contents: contents(parts) });
    if (before === null) return;
    this.#app.assets.remove(before);
    before.unload();
  }

  /**
   * Shows the scene with the lod-meta.json at a URL: the levels of detail that the view needs, of at most a million
   * Gaussians together, after the coarsest level of all. Resolves when the current view's are in the picture; throws
   * if there are none.
   */
  async stream(url: string): Promise<void> {
    this.#streamed = true;
    this.#app.scene.gsplat.splatBudget = COARSEST;
    await this.#enter({ url, filename: "lod-meta.json" });
  }

  /** Loads an asset and waits until it is in the picture. */
  async #enter(file: { url: string; filename: string; contents?: ArrayBuffer }): Promise<void> {
    const asset = new Asset("scene", "gsplat", file);
    const loaded = new Promise<void>((resolve, reject) => {
      asset.once("load", () => resolve());
      asset.once("error", reject);
    });
    this.#app.assets.add(asset);
    this.#app.assets.load(asset);
    await loaded;
    this.#asset = asset;
    if (this.#scene.gsplat) this.#scene.gsplat.asset = asset.id;
    await new Promise<void>((resolve, reject) => {
      this.#pending = resolve;
      // PlayCanvas waits for a file that has failed, and would show nothing.
      this.#app.assets.on("error", (error: string) => {
        if (!this.#visible) reject(new Error(error));
        this.#refining = true;
      });
    });
  }

  /** Follows the loading of a streamed scene: before its first file arrives, PlayCanvas shows nothing. */
  #frameReady(ready: boolean, waiting: number): void {
    this.#waiting = waiting;
    this.#mostWaiting = Math.max(this.#mostWaiting, waiting);
    if (!ready || this.#pending === null || (this.#streamed && waiting === this.#mostWaiting)) return;
    this.#visible = this.#changed = true;
    if (waiting > 0) return;
    if (this.#streamed && !this.#refining) {
      this.#refining = true;
      return;
    }
    this.#pending();
    this.#pending = null;
  }

  /**
   * Renders the view from a pose if the pose, lens, size or scene has changed; returns whether it did, with the scene
   * in the picture.
   */
  draw({ pose, lens, size, now, again = false }: View): boolean {
    const { width, height } = size;
    const matrix = projection(lens);
    const aim = [...pose.position, ...pose.quaternion, ...matrix, width, height];
    const changed = this.#changed || aim.some((value, i) => value !== this.#aim[i]);
    if (changed) {
      this.#aim = aim;
      this.#projection = matrix;
      this.#camera.setPosition(...pose.position);
      this.#camera.setRotation(...multiply(pose.quaternion, FLIPPED));
      this.#app.graphicsDevice.resizeCanvas(width, height);
    }
    this.#changed = false;
    if (this.#refining) this.#app.scene.gsplat.splatBudget = BUDGET; // not while PlayCanvas updates its levels
    const starting = this.#pending !== null && this.#waiting === 0; // otherwise, arriving data requests frames
    if (changed || again || starting) this.#app.renderNextFrame = true;
    this.#app.tick(now);
    cancelAnimationFrame(this.#app.frameRequestId);
    return this.#visible && (changed || this.#changed);
  }

  dispose(): void {
    this.#app.destroy();
    this.#canvas.getContext("webgl2")?.getExtension("WEBGL_lose_context")?.loseContext(); // browsers keep only a few
    this.#canvas.remove();
  }
}

/** PlayCanvas reads an asset's contents from a response. It keeps and modifies its input, so it gets copies. */
function contents(parts: readonly Uint8Array<ArrayBuffer>[]): ArrayBuffer {
  const rest = parts.values();
  let part = new Uint8Array<ArrayBuffer>(new ArrayBuffer(0));
  const stream = new ReadableStream({
    pull: (controller) => {
      while (part.length === 0) {
        const next = rest.next();
        if (next.done) return controller.close();
        part = next.value;
      }
      controller.enqueue(part.slice(0, COPIED));
      part = part.subarray(COPIED);
    },
  });
  return new Response(stream) as unknown as ArrayBuffer;
}

/** From the camera's axes to the clip space of OpenGL, column by column: fx, fy, cx and cy in pixels, y down. */
function projection({ fx, fy, cx, cy, width, height }: Lens): number[] {
  const depth = FAR - NEAR;
  return [
    (2 * fx) / width, 0, 0, 0,
    0, (2 * fy) / height, 0, 0,
    1 - (2 * cx) / width, (2 * cy) / height - 1, -(FAR + NEAR) / depth, -1,
    0, 0, (-2 * FAR * NEAR) / depth, 0,
  ]; // biome-ignore format: a matrix
}
