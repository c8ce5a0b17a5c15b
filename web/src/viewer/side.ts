/**
 * One picture of the scene with its own settings: the whole stage, or one side of a comparison. It owns all modes, and
 * the settings select the active one.
 */

import { computed, effect, type ReadonlySignal, signal, untracked } from "@preact/signals";
import { Listeners } from "../async/listeners";
import { Display } from "../enhance/display";
import { Enhancement } from "../enhance/enhancement";
import { Overlay } from "../enhance/overlay";
import { chosenEnhancers } from "../enhance/registry";
import type { LocalPlayer } from "../local/local-player";
import { turning } from "../reproject/acceleration";
import { Reprojector, reprojectionNote } from "../reproject/reprojector";
import { config, ladder } from "../state/app";
import { isPerView, isStreamed, type Mode } from "../state/settings";
import type { SideSettings } from "../state/sides";
import { Decoder } from "../stateless/decoder";
import { decodesWebp } from "../stateless/decodes-webp";
import type { DecodedFrame, SentRequest } from "../stateless/pipeline";
import { selectedController, videoSteps } from "../stateless/selected-controller";
import { type Reply, type ShownFrame, StatelessPlayer } from "../stateless/stateless-player";
import type { Pictured } from "../stateless/turning";
import type { StreamPlayer } from "../stream/stream-player";
import { type StreamedFrame, TurnedVideo } from "../stream/turned-video";
import type { Connected } from "../transport/connect";
import { videoProblem } from "../video/support";
import { VideoFrames } from "../video/video-frames";
import { viewDistance } from "../view/camera";
import type { Figures } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import type { Rig } from "../view/rig";
import type { SceneInfo } from "../wire/render";
import { keepDownload } from "./download-opening";
import { keepStream } from "./stream-opening";

export interface SideOptions {
  /** It fills this with a canvas and a video, of which the mode shows one. */
  readonly pane: HTMLElement;
  readonly rig: Rig;
  readonly scene: ReadonlySignal<SceneInfo | null>;
  /** Never the settings of the mode `side-by-side`. */
  readonly settings: ReadonlySignal<SideSettings>;
  /** Of the controller's random numbers. */
  readonly seed: ReadonlySignal<number>;
  /** Pixels of the screen along one of the viewport's; it changes when the window moves to another screen. */
  readonly pixelRatio: ReadonlySignal<number>;
  readonly onShown: (frame: ShownFrame) => void;
  readonly onSent: (request: SentRequest) => void;
  readonly onReplied: (reply: Reply) => void;
  readonly now: () => number;
}

export class Side {
  readonly settings: ReadonlySignal<SideSettings>;
  readonly enhancement: Enhancement;
  readonly reprojector: Reprojector<Pictured>;
  readonly stateless: StatelessPlayer;
  /** Of the mode `video`. */
  readonly video: VideoFrames;
  readonly videoReprojector: Reprojector<StreamedFrame>;
  /** Null in the other modes, and where there is no packager. */
  readonly stream = signal<StreamPlayer | null>(null);
  /** Null in the other modes. */
  readonly local = signal<LocalPlayer | null>(null);
  /** Notice to the user if pictures should be warped and are not; else null. */
  readonly unturned: ReadonlySignal<string | null>;
  readonly #display: Display<DecodedFrame>;
  readonly #decoder = new Decoder(
    new Worker(new URL("../stateless/decode.worker.ts", import.meta.url), { type: "module", name: "decoder" }),
  );
  readonly #presented = new Listeners<[PresentedFrame]>();
  /** Subscribes to every frame on screen; returns a function that unsubscribes. */
  readonly onPresented = this.#presented.add;
  readonly #elements: readonly HTMLElement[];
  readonly #cleanups: (() => void)[] = [];
  #decodesWebp = false;
  #received = 0;

  constructor(options: SideOptions) {
    const { pane, rig, scene, settings, seed, pixelRatio, onShown, onSent, onReplied, now } = options;
    this.settings = settings;
    const canvas = document.createElement("canvas");
    const video = silentVideo();
    pane.append(canvas, video);
    this.#elements = [canvas, video];
    this.#cleanups.push(
      effect(() => {
        pane.dataset.mode = settings.value.mode;
      }),
    );
    const overlay = new Overlay(canvas);
    this.enhancement = new Enhancement({ overlay, now });
    const size = () => {
      const { width, height } = rig.viewport.peek();
      const ratio = pixelRatio.peek();
      return { width: Math.round(width * ratio), height: Math.round(height * ratio) };
    };
    this.#display = new Display({ canvas, overlay, enhancement: this.enhancement, size });
    this.reprojector = new Reprojector({ below: canvas, size, now });
    this.videoReprojector = new Reprojector({ below: video, size, now, readable: TurnedVideo.supported });
    this.unturned = computed(() => reprojectionNote(this.reprojector.status.value, this.videoReprojector.status.value));
    this.video = new VideoFrames(
      () => new Worker(new URL("../video/video.worker.ts", import.meta.url), { type: "module", name: "video decoder" }),
      now,
    );
    const pixels = computed(() => {
      const { width, height } = rig.viewport.value;
      return width * height * pixelRatio.value ** 2;
    });
    const steps = videoSteps(settings, pixels);
    const controller = selectedController(settings, seed, pixels, steps);
    this.stateless = new StatelessPlayer({
      display: this.#display,
      reprojector: this.reprojector,
      webp: () => settings.peek().webp && this.#decodesWebp && config.peek()?.formats?.includes("webp") === true,
      overscan: () => settings.peek().overscan,
      depth: () => settings.peek().depth,
      surround: () => settings.peek().surround,
      ladder: () => ladder.peek(),
      rig,
      decoder: this.#decoder,
      video: this.video,
      videoSteps: () => steps.value,
      controller: () => controller.value,
      refine: () => settings.value.refine,
      bitrateKbps: () => settings.peek().bitrateKbps ?? null,
      pixelRatio: () => pixelRatio.peek(),
      prediction: () => settings.value.prediction,
      onPresented: this.#presented.tell,
      onShown,
      onSent,
      onReplied,
      onReceived: this.#count,
      now,
    });
    void decodesWebp().then((decodes) => {
      this.#decodesWebp = decodes;
    });
    this.#enhance(scene);
    this.#reproject(this.reprojector, isPerView, scene);
    this.#reproject(this.videoReprojector, isStreamed, scene);
    this.#beginVideo();
    const shared = { rig, onPresented: this.#presented.tell, onReceived: this.#count, now };
    this.#cleanups.push(
      keepStream(this.stream, scene, settings, { ...shared, video, reprojector: this.videoReprojector }),
      keepDownload(this.local, scene, settings, { ...shared, below: canvas, size }),
    );
  }

  /** Bytes of pictures received by all modes together. */
  get receivedBytes(): number {
    return this.#received;
  }

  /** Present figures of the mode's meter; null before its first frame. */
  get figures(): Figures | null {
    const { mode } = this.settings.value;
    if (isPerView(mode)) return this.stateless.stats.value;
    return (isStreamed(mode) ? this.stream : this.local).value?.stats.value ?? null;
  }

  /** Ask for views over this from now on; null while there is no connection. */
  attach(connected: Connected | null): void {
    this.stateless.attach(connected);
  }

  /** A copy of the screen; null before the first picture. */
  picture(): Promise<ImageBitmap> | null {
    const { mode } = this.settings.peek();
    if (isPerView(mode)) return this.stateless.picture();
    return (isStreamed(mode) ? this.stream : this.local).peek()?.picture() ?? null;
  }

  /** Called at the start of each animation frame: its subscribers find the last reported frame on screen. */
  presented(time: number): void {
    if (isPerView(this.settings.peek().mode)) this.stateless.presented(time);
    else this.stateless.suspend();
    this.stream.peek()?.presented(time);
    this.local.peek()?.presented(time);
  }

  /** The page was hidden for the last `gap` milliseconds; before anything else of this animation frame. */
  resumed(gap: number): void {
    this.stateless.resumed(gap);
    this.stream.peek()?.resumed(gap);
    this.local.peek()?.resumed(gap);
  }

  /** Called once per animation frame, after the rig was sampled; `moved` is the rig's result. */
  tick(time: number, moved: boolean): void {
    if (isPerView(this.settings.peek().mode)) this.stateless.tick(time, moved);
    this.stream.peek()?.tick(time, moved);
    this.local.peek()?.tick(time, moved);
  }

  dispose(): void {
    for (const cleanup of this.#cleanups) cleanup();
    this.stateless.dispose();
    this.enhancement.dispose();
    this.reprojector.off();
    this.videoReprojector.off();
    this.#display.dispose();
    this.#decoder.dispose();
    this.video.dispose();
    for (const element of this.#elements) element.remove();
  }

  readonly #count = (bytes: number): void => {
    this.#received += bytes;
  };

  /** By the models of the settings, and by others whenever those change or the scene is there. */
  #enhance(of: ReadonlySignal<SceneInfo | null>): void {
    const wanted = computed(() => {
      const { restore, upscale, mode } = this.settings.value;
      const scene = of.value;
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

  /** Decode video while its mode is chosen. */
  #beginVideo(): void {
    const chosen = computed(() => this.settings.value.mode === "video");
    const stop = effect(() => {
      if (!chosen.value) return undefined;
      void this.video.begin(videoProblem());
      return () => this.video.leave();
    });
    this.#cleanups.push(stop);
  }

  /** As the settings have it, once the scene is there, in the modes that show such pictures. */
  #reproject(
    reprojector: Pick<Reprojector<unknown>, "on" | "off">,
    shows: (mode: Mode) => boolean,
    of: ReadonlySignal<SceneInfo | null>,
  ): void {
    const distance = computed(() => {
      const scene = of.value;
      const { reprojection, mode } = this.settings.value;
      return reprojection && shows(mode) && scene !== null ? viewDistance(scene) : null;
    });
    const forced = computed(() => turning.value === "forced");
    const stop = effect(() => {
      const { value } = distance;
      void forced.value; // it begins anew once someone asks for it
      untracked(() => (value === null ? reprojector.off() : reprojector.on(value)));
    });
    this.#cleanups.push(stop);
  }
}

function silentVideo(): HTMLVideoElement {
  const video = document.createElement("video");
  return Object.assign(video, {
    muted: true,
    playsInline: true,
    disablePictureInPicture: true,
    disableRemotePlayback: true,
  });
}
