/**
 * The local mode: renders the scene in this browser. It downloads all of it and starts with the first part, or lets the
 * renderer stream levels of detail.
 */
import { signal } from "@preact/signals";
import { deferred } from "#client/async/deferred";
import { ApiError } from "#client/http/problem";
import type { SceneInfo } from "#client/wire/render";
import type { PlayedDownload } from "#client/wire/store";
import type { Size } from "../enhance/geometry";
import type { Settings } from "../state/settings";
import { type Figures, Meter, NO_FIGURES, STATS_EVERY } from "../view/meter";
import type { PresentedFrame, SourcePhase } from "../view/presented";
import type { NumberedPose, Rig } from "../view/rig";
import { download } from "./download";
import { arrived, BrokenPly, nextStep, type PlyHeader, type Prefix, prefixOf, readHeader } from "./ply";
import type { Lens, Renderer, RendererOptions } from "./renderer";
import { fileBytes, roomProblem } from "./room";

export interface LocalStats extends Figures {
  readonly kind: "download";
  /** Received and total bytes of the scene's file; null until the server has answered, and if streamed. */
  readonly received: number;
  readonly total: number | null;
  /** Rendered and total Gaussians; null until the header has arrived. */
  readonly drawn: number;
  readonly gaussians: number | null;
  /** Times since the mode was entered, in milliseconds; null before the event. */
  readonly firstPictureMs: number | null;
  readonly completeMs: number | null;
  /** The renderer; null until it works. */
  readonly backend: string | null;
}

export const NO_LOCAL_STATS: LocalStats = {
  kind: "download",
  ...NO_FIGURES,
  received: 0,
  total: null,
  drawn: 0,
  gaussians: null,
  firstPictureMs: null,
  completeMs: null,
  settled: false,
  backend: null,
};

/** The part of a `Renderer` that is used. */
export type LocalRenderer = Pick<Renderer, "backend" | "show" | "stream" | "draw" | "dispose">;

export interface LocalOptions {
  readonly pane: HTMLElement;
  readonly rig: Rig;
  readonly scene: SceneInfo;
  readonly form: Settings["localForm"];
  /** URL of the scene's file, which changes in a cluster. */
  readonly url: () => string;
  readonly size: () => Size;
  readonly onPresented: (frame: PresentedFrame) => void;
  readonly onReceived: (bytes: number) => void;
  readonly memory?: number | undefined;
  readonly create?: (options: RendererOptions) => Promise<LocalRenderer>;
}

/** The picture that was drawn last. */
interface Drawn extends Size {
  readonly pose: NumberedPose;
  readonly lens: Lens;
}

/** Why the scene is not drawn here, in one sentence. */
class Impossible extends Error {}

const DOWNLOADING: SourcePhase = { kind: "connecting", message: "Downloading the scene…" };
const NO_GRAPHICS = "This browser cannot draw Gaussians: it supports neither WebGPU nor WebGL 2.";
const LOST = "The graphics processor was lost. Choose the mode again to restart the download.";
const UNKNOWN = "The scene could not be drawn in this browser.";

export class LocalPlayer {
  readonly stats = signal<LocalStats>(NO_LOCAL_STATS);
  readonly phase = signal<SourcePhase>(DOWNLOADING);
  readonly #options: LocalOptions;
  readonly #meter: Meter;
  readonly #visit = new AbortController();
  readonly #canvas = document.createElement("canvas");
  readonly #beganAt: number;
  #renderer: LocalRenderer | null = null;
  /** The received part; empty once everything is rendered. */
  #file = new Uint8Array(0);
  #total = 0;
  #received = 0;
  #header: PlyHeader | null = null;
  /** Of the scene; null until known. */
  #gaussians: number | null = null;
  /** Gaussians handed to the renderer. */
  #given: Prefix | null = null;
  /** Resolves when more of the file has arrived. */
  #more = deferred<undefined>();
  #firstPictureMs: number | null = null;
  #completeMs: number | null = null;
  #drawn: Drawn | null = null;
  /** Whether the drawn picture has not been reported yet. */
  #untold = false;
  #publishedAt = 0;

  constructor(options: LocalOptions) {
    this.#options = options;
    this.#meter = new Meter("local", options.onPresented);
    this.#canvas.className = "local";
    this.#beganAt = performance.now();
    this.#run(this.#visit.signal).catch((error: unknown) => this.#failed(error));
  }

  /** Ends the download, and frees everything that it used. */
  dispose(): void {
    this.#visit.abort();
    this.#leave();
  }

  /** For records: the download so far, with times since `startedAt`. */
  played(startedAt: number): { readonly local: PlayedDownload } {
    return {
      local: {
        form: this.#options.form,
        renderer: this.#renderer?.backend ?? null,
        began_ms: this.#beganAt - startedAt,
        first_picture_ms: this.#firstPictureMs,
        complete_ms: this.#completeMs,
        downloaded_bytes: this.#received,
        bytes: this.#total,
        gaussians: this.#gaussians,
      },
    };
  }

  picture(): Promise<ImageBitmap> | null {
    if (this.#drawn === null || this.#renderer === null) return null;
    const { pose, lens, ...size } = this.#drawn;
    // The browser has taken the picture away to show it.
    this.#renderer.draw({ pose, lens, size, now: performance.now(), again: true });
    return createImageBitmap(this.#canvas);
  }

  presented(now: number): void {
    if (this.#drawn === null || !this.#untold) return;
    this.#untold = false;
    if (this.phase.peek().kind === "connecting") this.phase.value = { kind: "playing" };
    this.#firstPictureMs ??= now - this.#beganAt;
    if (this.#given?.whole) this.#completeMs ??= now - this.#beganAt;
    const { pose, width, height } = this.#drawn;
    this.#meter.presented({ at: now, pose: pose.seq, rung: null, width, height });
  }

  /** A picture drawn before the gap still counts: at rest no other follows, and the first one may cause the gap. */
  resumed(gap: number): void {
    this.#meter.resumed(gap);
  }

  tick(now: number, moved: boolean): void {
    const { rig, size } = this.#options;
    const { pose } = rig;
    this.#meter.sampled(pose.seq, now);
    // Until there is a picture, poses wait for the download, which is not latency.
    if (moved && this.#firstPictureMs !== null) this.#meter.moved(pose.seq, now);
    const lens = { ...rig.intrinsics.peek(), ...rig.viewport.peek() };
    if (this.#renderer?.draw({ pose, lens, size: size(), now })) {
      this.#drawn = { pose, lens, ...size() };
      this.#untold = true;
      if (!this.#canvas.isConnected) this.#options.pane.append(this.#canvas);
    }
    if (now - this.#publishedAt < STATS_EVERY) return;
    this.#publishedAt = now;
    this.#publish(now);
  }

  #publish(now: number): void {
    this.stats.value = {
      kind: "download",
      ...this.#meter.figures(now),
      received: this.#received,
      total: this.#total || null,
      drawn: this.#given?.gaussians ?? 0,
      gaussians: this.#gaussians,
      firstPictureMs: this.#firstPictureMs,
      completeMs: this.#completeMs,
      settled: this.#completeMs !== null,
      backend: this.#renderer?.backend ?? null,
    };
  }

  async #run(signal: AbortSignal): Promise<void> {
    await (this.#options.form === "streamed" ? this.#stream(signal) : this.#download(signal));
  }

  async #stream(signal: AbortSignal): Promise<void> {
    const renderer = await this.#create(signal);
    if (renderer === null) return;
    const address = new URL(this.#options.url(), document.baseURI).href;
    const watch = watchTransfers(new URL(".", address).href, (bytes) => this.#got(bytes));
    signal.addEventListener("abort", () => watch.disconnect());
    await renderer.stream(address).catch(cannotDraw);
    this.#gaussians = this.#options.scene.gaussians;
    this.#given = { gaussians: this.#gaussians ?? 0, whole: true };
  }

  async #download(signal: AbortSignal): Promise<void> {
    const { scene, url, memory } = this.#options;
    const gaussians = scene.gaussians ?? 0;
    const shDegree = scene.sh_degree ?? 3;
    const made = scene.downloads?.find(({ form }) => form === "compressed")?.bytes;
    const bytes = made ?? fileBytes(gaussians, shDegree);
    const problem = roomProblem({ gaussians, shDegree, bytes }, memory);
    if (problem !== null) throw new Impossible(problem);
    const whole = download({
      url,
      signal,
      onBytes: (file, received) => {
        this.#got(received - this.#received);
        this.#came(file, received);
      },
      onCut: (message) => {
        this.phase.value = { kind: "lost", message };
      },
    });
    await Promise.all([whole, this.#draw(signal)]);
  }

  #got(bytes: number): void {
    this.#received += bytes;
    this.#options.onReceived(bytes);
    this.#meter.received(bytes, performance.now());
  }

  #came(file: Uint8Array<ArrayBuffer>, received: number): void {
    if (file !== this.#file) {
      this.#header = this.#given = null; // the server has a different version by now
      this.#file = file;
      this.#total = file.length;
    }
    if (this.phase.peek().kind === "lost") {
      this.phase.value = this.#firstPictureMs === null ? DOWNLOADING : { kind: "playing" };
    }
    this.#header ??= readHeader(file.subarray(0, received));
    this.#gaussians = this.#header?.gaussians ?? null;
    this.#more.resolve(undefined);
  }

  /** Renders more whenever enough has arrived, until everything is rendered. */
  async #draw(signal: AbortSignal): Promise<void> {
    const renderer = await this.#create(signal);
    if (renderer === null) return;
    while (!this.#given?.whole && !signal.aborted) {
      this.#more = deferred<undefined>();
      const header = this.#header;
      const step = header && nextStep(header, arrived(header, this.#received), this.#given);
      if (step === null) {
        await this.#more.promise;
      } else {
        await renderer.show(prefixOf(header as PlyHeader, this.#file, step)).catch(cannotDraw);
        this.#given = step;
      }
    }
    this.#file = new Uint8Array(0); // the rendered Gaussians are on the GPU
  }

  /** The renderer; null if the mode has been left meanwhile. */
  async #create(signal: AbortSignal): Promise<LocalRenderer | null> {
    const { create = (await this.#load()).createRenderer, scene } = this.#options;
    let renderer: LocalRenderer;
    try {
      renderer = await create({
        canvas: this.#canvas,
        background: scene.background,
        antialiased: scene.antialiased ?? false,
        onLost: () => this.#failed(new Impossible(LOST)),
      });
    } catch (error) {
      const none = error instanceof Error && error.name === "NoGraphics";
      if (none) throw new Impossible(NO_GRAPHICS);
      return cannotDraw(error);
    }
    if (signal.aborted) {
      renderer.dispose();
      return null;
    }
    this.#renderer = renderer;
    return renderer;
  }

  #load(): Promise<typeof import("./renderer")> {
    return import("./renderer").catch(() => {
      throw new Impossible("The renderer could not be loaded from the server.");
    });
  }

  #failed(error: unknown): void {
    if (this.#visit.signal.aborted) return;
    this.#visit.abort();
    this.#leave();
    const known = error instanceof ApiError || error instanceof BrokenPly || error instanceof Impossible;
    this.phase.value = { kind: "failed", message: known ? error.message : UNKNOWN };
  }

  #leave(): void {
    this.#renderer?.dispose();
    this.#renderer = null;
    this.#drawn = null;
    this.#canvas.remove();
    this.#file = new Uint8Array(0);
  }
}

/** Reports the bytes of each file below a URL once it has been transferred. */
function watchTransfers(base: string, onBytes: (bytes: number) => void): PerformanceObserver {
  const observer = new PerformanceObserver((list) => {
    for (const entry of list.getEntries() as PerformanceResourceTiming[]) {
      if (entry.name.startsWith(base)) onBytes(entry.transferSize);
    }
  });
  observer.observe({ type: "resource" });
  return observer;
}

function cannotDraw(error: unknown): never {
  const message = error instanceof Error ? error.message : String(error);
  throw new Impossible(`The scene cannot be drawn in this browser: ${message.replace(/\.?$/, ".")}`);
}
