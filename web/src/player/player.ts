/** The viewer's loop: once per animation frame it samples the input, wants the view that follows, and shows what has come. */
import { computed, type ReadonlySignal, signal } from "@preact/signals";
import type { Controller } from "../abr/controller";
import { type Camera, levelFor, startCamera, toScene } from "../camera/camera";
import { defaultIntrinsics, type Intrinsics, type Viewport, viewportFor } from "../camera/intrinsics";
import { type Speeds, step, suggestedSpeed } from "../input/motion";
import type { Sample } from "../input/stage-input";
import type { Connected } from "../transport/connect";
import type { SceneInfo } from "../wire";
import type { Decoder } from "./decoder";
import { MotionToPhoton } from "./motion-to-photon";
import { FramePipeline, type View } from "./pipeline";
import { NO_STATS, type Stats, StatsRecorder } from "./stats";

export interface PlayerOptions {
  readonly canvas: HTMLCanvasElement;
  readonly decoder: Pick<Decoder, "decode">;
  /** What was asked since the last sample, so many milliseconds ago. */
  readonly sampleInput: (elapsed: number) => Sample;
  readonly controller: () => Controller;
  /** Whether to ask for the view at the best rung once it stands still. */
  readonly refine: () => boolean;
  /** Degrees a second. */
  readonly turnSpeed: () => number;
  readonly now: () => number;
}

/** The camera stands still when nothing moved it for this long, in milliseconds. */
const STILL_AFTER = 300;
/** How often the HUD changes: often enough to be live, seldom enough to be read (ms). */
const STATS_EVERY = 250;

export class Player {
  readonly stats = signal<Stats>(NO_STATS);
  /** Why the server refuses frames at the moment, or null. */
  readonly problem = signal<string | null>(null);
  readonly viewport = signal<Viewport>({ width: 1, height: 1 });
  /** Intrinsics that a person set; the others follow the viewport. */
  readonly lens = signal<Partial<Intrinsics>>({});
  readonly intrinsics: ReadonlySignal<Intrinsics> = computed(() => ({
    ...defaultIntrinsics(this.viewport.value),
    ...this.lens.value,
  }));
  /** Scene units a second. */
  readonly moveSpeed = signal(1);
  readonly #options: PlayerOptions;
  readonly #context: ImageBitmapRenderingContext;
  readonly #latency = new MotionToPhoton();
  #recorder = new StatsRecorder();
  #scene: SceneInfo | undefined;
  #camera: Camera = { position: [0, 0, 0], azimuth: 0, elevation: 0 };
  #pipeline: FramePipeline | undefined;
  #connected: Connected | undefined;
  #animation = 0;
  #sampledAt = 0;
  #version = 0;
  #changedAt = 0;
  #refining = false;
  #presenting: number | undefined;
  #publishedAt = 0;

  constructor(options: PlayerOptions) {
    this.#options = options;
    const context = options.canvas.getContext("bitmaprenderer");
    if (context === null) throw new Error("this browser cannot draw decoded images");
    this.#context = context;
  }

  /** Show a scene, from its start camera. */
  enter(scene: SceneInfo): void {
    this.#scene = scene;
    this.resetCamera();
    const { camera } = scene;
    this.moveSpeed.value = suggestedSpeed(
      camera === null ? 4 : Math.hypot(...camera.position.map((value, i) => value - (camera.look_at[i] ?? 0))),
    );
    this.#animation ||= requestAnimationFrame(this.#tick);
  }

  resetCamera(): void {
    if (this.#scene) this.#camera = startCamera(this.#scene);
    this.#changedAt = this.#options.now();
  }

  /** The stage has this many CSS pixels. */
  resize(width: number, height: number): void {
    if (width >= 1 && height >= 1) this.viewport.value = viewportFor(width, height);
  }

  /** Use this transport from now on; null while there is none. */
  attach(connected: Connected | null): void {
    this.#pipeline?.dispose();
    this.#latency.reset();
    this.#recorder = new StatsRecorder();
    this.#connected = connected ?? undefined;
    this.#presenting = undefined;
    const { decoder, now } = this.#options;
    this.#pipeline =
      connected === null
        ? undefined
        : new FramePipeline(connected.transport, (image, signal) => decoder.decode(image, signal), now, {
            replied: (reply) => {
              this.#recorder.replied(reply, now());
              this.problem.value = null;
              this.#options.controller().observe({
                profile: reply.header.profile ?? null,
                bytes: reply.arrival.bytes,
                roundTrip: reply.arrival.lastByteAt - reply.arrival.sentAt,
                throughput: this.#recorder.throughput.bitsPerSecond,
                at: now(),
              });
            },
            refused: (problem) => {
              this.problem.value = problem.message;
            },
            transmission: (bytes) => {
              const rate = this.#recorder.throughput.bitsPerSecond;
              return rate === null ? 0 : (bytes * 8000) / rate;
            },
          });
  }

  dispose(): void {
    cancelAnimationFrame(this.#animation);
    this.attach(null);
  }

  readonly #tick = (): void => {
    this.#animation = requestAnimationFrame(this.#tick);
    const now = this.#options.now();
    this.#presented(now);
    const moved = this.#sample(now);
    const scene = this.#scene;
    if (this.#pipeline && scene) {
      const version = this.#pipeline.want(this.#view(scene, now));
      if (moved && version !== this.#version) this.#latency.sampled(version, now);
      this.#version = version;
      const frame = this.#pipeline.take();
      if (frame) {
        this.#context.transferFromImageBitmap(frame.bitmap);
        this.#presenting = frame.version;
      }
    }
    this.#publish(now);
  };

  /** The frame that was handed to the compositor in the last animation frame is on the screen by now. */
  #presented(now: number): void {
    if (this.#presenting === undefined) return;
    this.#recorder.presented(this.#latency.presented(this.#presenting, now), now);
    this.#presenting = undefined;
  }

  #sample(now: number): boolean {
    const elapsed = now - this.#sampledAt;
    const { axes, nudge } = this.#options.sampleInput(elapsed);
    const speeds: Speeds = { turn: this.#options.turnSpeed(), move: this.moveSpeed.value };
    const camera = step(this.#camera, axes, nudge, speeds, elapsed);
    this.#sampledAt = now;
    const moved = camera !== this.#camera;
    this.#camera = camera;
    if (moved) this.#changedAt = now;
    return moved;
  }

  #view(scene: SceneInfo, now: number): View {
    const still = now - this.#changedAt > STILL_AFTER;
    this.#refining = this.#options.refine() && still && (this.#refining || this.#pipeline?.settled === true);
    return {
      scene: scene.id,
      ...toScene(this.#camera, levelFor(scene.up)),
      ...this.intrinsics.value,
      ...this.viewport.value,
      profile: this.#refining ? 0 : this.#options.controller().decide(),
    };
  }

  #publish(now: number): void {
    const pipeline = this.#pipeline;
    const settled = pipeline?.settled ?? true;
    if (now - this.#publishedAt < STATS_EVERY && settled === this.stats.peek().settled) return;
    this.#publishedAt = now;
    this.stats.value = this.#recorder.snapshot(now, {
      transport: this.#connected?.transport.kind ?? null,
      inFlight: pipeline?.inFlight ?? 0,
      settled,
      ...(pipeline && { counts: pipeline.counts }),
    });
  }
}
