/**
 * Modes with one request per pose: `stateless`, where each answer is an independent picture, and `video` (`video.ts`),
 * where each is the next frame of a video.
 */
import { computed, effect, type ReadonlySignal, untracked } from "@preact/signals";
import { Display } from "../enhance/display";
import { Enhancement } from "../enhance/enhancement";
import { Overlay } from "../enhance/overlay";
import { chosenEnhancers } from "../enhance/registry";
import { Reprojector } from "../reproject/reprojector";
import { decodesWebp } from "../stateless/picture-format";
import type { DecodedFrame } from "../stateless/pipeline";
import { selectedController, videoSteps } from "../stateless/selected-controller";
import { StatelessPlayer } from "../stateless/stateless-player";
import type { Pictured } from "../stateless/turning";
import type { VideoFrames } from "../video/video-frames";
import type { SourcePhase } from "../view/presented";
import { keepTurning } from "./keep-turning";
import type { Source, SourceContext, SourceKind } from "./source";

export const STATELESS: SourceKind = {
  title: "Stateless",
  about: "Single pictures: one for each camera pose, each independent of the others.",
  settings: [
    ...(["transport", "controller", "profile", "refine", "webp", "restore", "upscale"] as const),
    ...(["reprojection", "prediction", "overscan", "depth", "surround"] as const),
  ],
  reopens: [],
  requests: true,
  drawsHere: false,
  keepsHidden: false,
  charts: false,
  missing: () => null,
  load: async () => (context) => new Pictures(context, null),
};

export class Pictures implements Source {
  readonly phase: ReadonlySignal<SourcePhase>;
  readonly stats: StatelessPlayer["stats"];
  readonly enhancement: Enhancement;
  readonly reprojection: Source["reprojection"];
  readonly #reprojector: Reprojector<Pictured>;
  readonly #player: StatelessPlayer;
  readonly #cleanups: readonly (() => void)[];
  #decodesWebp = false;

  /** `video` is null if each answer is an independent picture. */
  constructor(context: SourceContext, video: VideoFrames | null) {
    const { pane, rig, settings, scene, config, ladder, connection, seed, pixelRatio, size } = context;
    const canvas = document.createElement("canvas");
    pane.append(canvas);
    const overlay = new Overlay(canvas);
    this.enhancement = new Enhancement({ overlay });
    const display = new Display<DecodedFrame>({ canvas, overlay, enhancement: this.enhancement, size });
    this.#reprojector = new Reprojector({ below: canvas, size });
    this.reprojection = this.#reprojector.status;
    const pixels = computed(() => {
      const { width, height } = rig.viewport.value;
      return width * height * pixelRatio.value ** 2;
    });
    const steps = videoSteps(video !== null, settings, ladder, pixels);
    const controller = selectedController(settings, ladder, seed, pixels, steps);
    this.#player = new StatelessPlayer({
      ...context,
      display,
      reprojector: this.#reprojector,
      webp: () => settings.peek().webp && this.#decodesWebp && config.peek()?.formats?.includes("webp") === true,
      video,
      videoSteps: steps,
      controller,
    });
    this.stats = this.#player.stats;
    this.phase = computed(() => {
      const message = video?.problem.value ?? null;
      const problem = this.#player.problem.value;
      if (message !== null) return { kind: "failed", message };
      return { kind: "playing", ...(problem !== null && { problem }) };
    });
    void decodesWebp().then((decodes) => {
      this.#decodesWebp = decodes;
    });
    this.#cleanups = [
      effect(() => {
        const { value } = connection;
        untracked(() => this.#player.attach(value));
      }),
      this.#enhance(context),
      keepTurning(this.#reprojector, settings, scene),
      () => this.#player.dispose(),
      () => this.enhancement.dispose(),
      () => this.#reprojector.off(),
      () => display.dispose(),
      () => video?.dispose(),
      () => canvas.remove(),
    ];
  }

  get content(): Source["content"] {
    return this.#reprojector.content ?? null;
  }

  picture(): Promise<ImageBitmap> {
    return this.#player.picture();
  }

  presented(now: number): void {
    this.#player.presented(now);
  }

  resumed(gap: number): void {
    this.#player.resumed(gap);
  }

  tick(now: number, moved: boolean): void {
    this.#player.tick(now, moved);
  }

  dispose(): void {
    for (const cleanup of this.#cleanups) cleanup();
  }

  /** Enhances pictures with the models of the settings, and with others when those, the scene or its ladder change. */
  #enhance({ settings, scene, ladder, config }: SourceContext): () => void {
    const wanted = computed(() => {
      const { restore, upscale } = settings.value;
      const none = chosenEnhancers({ restore, upscale }).length === 0;
      if (none || scene.value === null || ladder.value.length === 0) return null;
      const { id, enhance } = scene.value;
      const { host, render_url } = config.value ?? {};
      const place = { scene: { id, enhance }, ladder: ladder.value, host: { host, render_url } };
      // As text, so that only changed content counts as a change; the configuration is read repeatedly.
      return JSON.stringify({ names: { restore, upscale }, place });
    });
    return effect(() => {
      if (wanted.value === null) {
        untracked(() => this.enhancement.off());
      } else {
        const { names, place } = JSON.parse(wanted.value);
        untracked(() => this.enhancement.choose(chosenEnhancers(names), place));
      }
    });
  }
}
