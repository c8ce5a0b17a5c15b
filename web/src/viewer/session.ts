/** One visit to one scene: connects, loads the scene, and shows what the rig sees in the chosen mode, until it is disposed of. */

import { computed, effect, signal, untracked } from "@preact/signals";
import { sleep } from "../async/sleep";
import type { DashPlayer } from "../dash/dash-player";
import { type StreamedFrame, TurnedVideo } from "../dash/turned-video";
import { Display } from "../enhance/display";
import { Enhancement } from "../enhance/enhancement";
import { Overlay } from "../enhance/overlay";
import { chosenEnhancers } from "../enhance/registry";
import { ApiError } from "../http/problem";
import { StageInput } from "../input/stage-input";
import type { LocalPlayer } from "../local/local-player";
import { MovementDeck } from "../movement/movement-deck";
import { Reprojector } from "../reproject/reprojector";
import { fetchConfig, loadScene } from "../state/api";
import { config, ladder, sceneLadder, settings } from "../state/app";
import { isPerView, isStreamed, type Mode } from "../state/settings";
import { Decoder } from "../stateless/decoder";
import { decodesWebp } from "../stateless/decodes-webp";
import type { DecodedFrame, SentRequest } from "../stateless/pipeline";
import { selectedController, videoSteps } from "../stateless/selected-controller";
import { type Reply, type ShownFrame, StatelessPlayer } from "../stateless/stateless-player";
import type { Pictured } from "../stateless/turning";
import { type Connected, connect } from "../transport/connect";
import { type ConnectionState, maintainConnection } from "../transport/connection";
import { videoProblem } from "../video/support";
import { VideoFrames } from "../video/video-frames";
import { viewDistance } from "../view/camera";
import type { PresentedFrame } from "../view/presented";
import { Rig } from "../view/rig";
import type { SceneInfo } from "../wire/render";
import { keepDownload } from "./download-opening";
import { keepStream } from "./stream-opening";

/** How the visit stands; `failed` waits for the person. */
export type Phase =
  | { readonly kind: "connecting" }
  | { readonly kind: "loading" }
  | { readonly kind: "playing" }
  | { readonly kind: "lost"; readonly message: string }
  | { readonly kind: "full" }
  | { readonly kind: "failed"; readonly message: string };

/** Where a visit is shown: both pictures are always there, and the mode says which are seen. */
export interface Stage {
  readonly element: HTMLElement;
  readonly canvas: HTMLCanvasElement;
  readonly video: HTMLVideoElement;
}

export class ViewerSession {
  readonly phase = signal<Phase>({ kind: "connecting" });
  readonly scene = signal<SceneInfo | null>(null);
  readonly connected = signal<Connected | null>(null);
  /** Connected, but the server does not answer. */
  readonly silent = signal(false);
  readonly rig: Rig;
  readonly movement: MovementDeck;
  readonly enhancement: Enhancement;
  readonly reprojector: Reprojector<Pictured>;
  readonly stateless: StatelessPlayer;
  /** Of the DASH side. */
  readonly videoReprojector: Reprojector<StreamedFrame>;
  /** The DASH side; null in stateless mode, and where there is no packager. */
  readonly dash = signal<DashPlayer | null>(null);
  /** Null in the other modes. */
  readonly local = signal<LocalPlayer | null>(null);
  readonly input: StageInput;
  readonly stage: Stage;
  /** Of the controllers' random numbers. */
  readonly seed = signal(1);
  readonly #sceneId: string;
  readonly #display: Display<DecodedFrame>;
  readonly #decoder = new Decoder(
    new Worker(new URL("../stateless/decode.worker.ts", import.meta.url), { type: "module", name: "decoder" }),
  );
  /** Of the mode `video`. */
  readonly video = new VideoFrames(
    () => new Worker(new URL("../video/video.worker.ts", import.meta.url), { type: "module", name: "video decoder" }),
    now,
  );
  #decodesWebp = false;
  /** The picture's pixels on the screen. */
  readonly #pixels = computed(() => {
    const { width, height } = this.rig.viewport.value;
    return width * height * devicePixelRatio ** 2;
  });
  readonly #videoSteps = videoSteps(this.#pixels);
  readonly #controller = selectedController(this.seed, this.#pixels, this.#videoSteps);
  readonly #listeners = new Set<(frame: PresentedFrame) => void>();
  readonly #shownListeners = new Set<(frame: ShownFrame) => void>();
  readonly #sentListeners = new Set<(request: SentRequest) => void>();
  readonly #replyListeners = new Set<(reply: Reply) => void>();
  #loading: Promise<SceneInfo> | undefined;
  /** Where it is loaded, in a cluster. */
  #host: string | null = null;
  #animation = 0;
  #received = 0;
  /** Counts connections that a person asked for. */
  readonly #attempt = signal(0);
  readonly #cleanups: (() => void)[] = [];

  /** `stamp`: frames carry their pose's number, for tests that read it from the screen. */
  constructor(sceneId: string, stage: Stage, stamp: boolean) {
    this.#sceneId = sceneId;
    this.stage = stage;
    this.input = new StageInput(stage.element, () => this.rig.intrinsics.value);
    this.rig = new Rig({
      sampleInput: (elapsed) => this.input.sample(elapsed),
      turnSpeed: () => settings.value.turnSpeed,
    });
    this.movement = new MovementDeck(this.rig);
    const overlay = new Overlay(stage.canvas);
    this.enhancement = new Enhancement({ overlay, now });
    const size = () => {
      const { width, height } = this.rig.viewport.peek();
      return { width: Math.round(width * devicePixelRatio), height: Math.round(height * devicePixelRatio) };
    };
    this.#display = new Display({ canvas: stage.canvas, overlay, enhancement: this.enhancement, size });
    this.reprojector = new Reprojector({ below: stage.canvas, size, now });
    this.videoReprojector = new Reprojector({ below: stage.video, size, now, readable: TurnedVideo.supported });
    this.stateless = new StatelessPlayer({
      display: this.#display,
      reprojector: this.reprojector,
      webp: () => settings.peek().webp && this.#decodesWebp && config.peek()?.formats?.includes("webp") === true,
      overscan: () => settings.peek().overscan,
      depth: () => settings.peek().depth,
      surround: () => settings.peek().surround,
      ladder: () => ladder.peek(),
      rig: this.rig,
      decoder: this.#decoder,
      video: this.video,
      videoSteps: () => this.#videoSteps.value,
      controller: () => this.#controller.value,
      refine: () => settings.value.refine,
      pixelRatio: () => devicePixelRatio,
      prediction: () => settings.value.prediction,
      stamp,
      onPresented: this.#tell,
      onShown: (frame) => {
        for (const listener of this.#shownListeners) listener(frame);
      },
      onSent: (request) => {
        for (const listener of this.#sentListeners) listener(request);
      },
      onReplied: (reply) => {
        for (const listener of this.#replyListeners) listener(reply);
      },
      onReceived: this.#count,
      now,
    });
    void decodesWebp().then((decodes) => {
      this.#decodesWebp = decodes;
    });
    this.#follow(stage);
    this.#enhance();
    this.#reproject(this.reprojector, isPerView);
    this.#reproject(this.videoReprojector, isStreamed);
    this.#beginVideo();
    this.#connect();
    this.#followLadder();
    this.#cleanups.push(
      keepStream(this.dash, this.scene, {
        video: stage.video,
        rig: this.rig,
        stamp,
        reprojector: this.videoReprojector,
        onPresented: this.#tell,
        onReceived: this.#count,
        now,
      }),
    );
    this.#cleanups.push(
      keepDownload(this.local, this.scene, {
        below: stage.canvas,
        rig: this.rig,
        size,
        onPresented: this.#tell,
        onReceived: this.#count,
        now,
      }),
    );
    this.#animation = requestAnimationFrame(this.#tick);
  }

  /** Bytes of pictures that have come in, by all modes together. */
  get receivedBytes(): number {
    return this.#received;
  }

  /** Hear of every frame that is on the screen, until the function that this returns is called. */
  onPresented(listener: (frame: PresentedFrame) => void): () => void {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** Hear of every frame of the stateless mode that is on the screen, as it came, until the function that this returns is called. */
  onShown(listener: (frame: ShownFrame) => void): () => void {
    this.#shownListeners.add(listener);
    return () => this.#shownListeners.delete(listener);
  }

  /** Hear of every request of the stateless mode, until the function that this returns is called. */
  onSent(listener: (request: SentRequest) => void): () => void {
    this.#sentListeners.add(listener);
    return () => this.#sentListeners.delete(listener);
  }

  /** Hear of every frame that came in the stateless mode, until the function that this returns is called. */
  onReplied(listener: (reply: Reply) => void): () => void {
    this.#replyListeners.add(listener);
    return () => this.#replyListeners.delete(listener);
  }

  /** After a failure: connect and load again. */
  retry(): void {
    this.#attempt.value++;
  }

  dispose(): void {
    cancelAnimationFrame(this.#animation);
    sceneLadder.value = null;
    for (const cleanup of this.#cleanups) cleanup();
    this.movement.dispose();
    this.input.dispose();
    this.stateless.dispose();
    this.enhancement.dispose();
    this.reprojector.off();
    this.videoReprojector.off();
    this.#display.dispose();
    this.#decoder.dispose();
    this.video.dispose();
  }

  readonly #count = (bytes: number): void => {
    this.#received += bytes;
  };

  readonly #tell = (frame: PresentedFrame): void => {
    for (const listener of this.#listeners) listener(frame);
  };

  /** The loop: one sample of the input per animation frame, for every mode the same. */
  readonly #tick = (): void => {
    this.#animation = requestAnimationFrame(this.#tick);
    const time = now();
    const stateless = isPerView(settings.peek().mode);
    // Before the sample: whoever hears of it finds on the canvas the frame that was told of last.
    if (stateless) this.stateless.presented(time);
    else this.stateless.suspend();
    this.dash.peek()?.presented(time);
    this.local.peek()?.presented(time);
    const moved = this.rig.sample(time);
    if (stateless) this.stateless.tick(time, moved);
    this.dash.peek()?.tick(time, moved);
    this.local.peek()?.tick(time, moved);
  };

  /** The viewport is that of the picture that is seen; both have the same size. */
  #follow({ element, canvas, video }: Stage): void {
    const observer = new ResizeObserver(() => {
      const seen = [canvas, video].find(({ clientWidth }) => clientWidth > 0);
      if (seen) this.rig.resize(seen.clientWidth, seen.clientHeight);
    });
    for (const one of [element, canvas, video]) observer.observe(one);
    this.#cleanups.push(() => observer.disconnect());
  }

  /** By the models of the settings, and by others whenever those change or the scene is there. */
  #enhance(): void {
    const wanted = computed(() => {
      const { restore, upscale, mode } = settings.value;
      const scene = this.scene.value;
      const none = chosenEnhancers({ restore, upscale }).length === 0;
      if (none || !isPerView(mode) || scene === null || ladder.value.length === 0) return null;
      // As text, so that only a change of its content is one; the configuration is read again and again.
      return JSON.stringify({ names: { restore, upscale }, place: { scene, ladder: ladder.value } });
    });
    const stop = effect(() => {
      if (wanted.value === null) {
        untracked(() => this.enhancement.off());
      } else {
        const { names, place } = JSON.parse(wanted.value);
        untracked(() => this.enhancement.choose(chosenEnhancers(names), place));
      }
    });
    this.#cleanups.push(stop);
  }

  /** Whenever the mode is chosen. */
  #beginVideo(): void {
    const chosen = computed(() => settings.value.mode === "video");
    const stop = effect(() => {
      if (chosen.value) void this.video.begin(videoProblem());
    });
    this.#cleanups.push(stop);
  }

  /** As the settings have it, once the scene is there, in the modes that show this side. */
  #reproject(reprojector: Pick<Reprojector<unknown>, "on" | "off">, shows: (mode: Mode) => boolean): void {
    const distance = computed(() => {
      const scene = this.scene.value;
      const { reprojection, mode } = settings.value;
      return reprojection && shows(mode) && scene !== null ? viewDistance(scene) : null;
    });
    const stop = effect(() => {
      const { value } = distance;
      untracked(() => (value === null ? reprojector.off() : reprojector.on(value)));
    });
    this.#cleanups.push(stop);
  }

  /** What is refused may be a rung that is gone: the scene's ladder can be another than when it was entered. */
  #followLadder(): void {
    const refused = computed(() => this.stateless.problem.value !== null);
    const visit = new AbortController();
    const stop = effect(() => {
      if (!refused.value || this.scene.peek() === null) return;
      const reread = loadScene(this.#sceneId, visit.signal, this.#host).then((scene) => {
        if (!visit.signal.aborted) sceneLadder.value = scene.ladder ?? null;
      });
      reread.catch(() => undefined); // what was refused is said already
    });
    this.#cleanups.push(() => {
      stop();
      visit.abort();
    });
  }

  /** Connects, and connects anew whenever another transport is chosen. */
  #connect(): void {
    const choice = computed(() => settings.value.transport);
    const stop = effect(() => {
      const chosen = choice.value;
      this.#attempt.value; // an effect runs again when what it read changes
      const connection = new AbortController();
      void maintainConnection(
        {
          fetchConfig: async (signal, report) => {
            config.value = await fetchConfig(signal, { scene: this.#sceneId, ...report });
            return config.value;
          },
          connect: async (server, signal) => {
            const loading = this.#loadAt(server.host ?? null, connection.signal);
            loading.catch(() => undefined); // #play hears of a failure
            // What is shown goes on until another host is ready; else both happen side by side.
            if (this.connected.peek() !== null) await loading.catch(() => undefined);
            return connect(server, chosen, signal, now);
          },
          onState: (state) => untracked(() => this.#heard(state, connection.signal)),
          onSilence: (silent) => {
            this.silent.value = silent;
          },
          sleep,
          now,
        },
        connection.signal,
      );
      return () => connection.abort();
    });
    this.#cleanups.push(stop);
  }

  #heard(state: ConnectionState, signal: AbortSignal): void {
    this.connected.value = state.status === "connected" ? state : null;
    if (state.status !== "connected") this.stateless.attach(null);
    if (state.status === "lost") this.#loading = undefined; // started again, the server may have another ladder for it
    if (state.status === "connecting") this.phase.value = { kind: "connecting" };
    else if (state.status === "lost") this.phase.value = { kind: "lost", message: state.reason };
    else if (state.status === "full") this.phase.value = { kind: "full" };
    else void this.#play(state, signal);
  }

  /** Asks for the scene at another host than before, or as `#load`. */
  #loadAt(host: string | null, signal: AbortSignal): Promise<SceneInfo> {
    if (host !== this.#host) this.#loading = undefined;
    this.#host = host;
    return this.#load(signal);
  }

  /** Asks for the scene once at a time; after a failure it may be asked for again. */
  #load(signal: AbortSignal): Promise<SceneInfo> {
    this.#loading ??= loadScene(this.#sceneId, signal, this.#host).catch((error: unknown) => {
      this.#loading = undefined;
      throw error;
    });
    return this.#loading;
  }

  async #play(connected: Connected, signal: AbortSignal): Promise<void> {
    const entering = this.scene.value === null;
    if (entering) this.phase.value = { kind: "loading" };
    let scene: SceneInfo;
    try {
      scene = await this.#load(signal);
    } catch (error) {
      if (signal.aborted || !(error instanceof ApiError) || error.unreachable) return; // the connection will say
      this.phase.value = { kind: "failed", message: error.message };
      return;
    }
    if (entering) {
      this.rig.enter(scene);
      this.scene.value = scene;
    }
    sceneLadder.value = scene.ladder ?? null;
    if (this.connected.value?.transport !== connected.transport) return; // it was lost meanwhile
    this.stateless.attach(connected);
    this.phase.value = { kind: "playing" };
  }
}

const now = () => performance.now();
