/**
 * Plays a movement in the viewer and records it: scripts (`bridge.ts`) and the experiment dialogue (`experiment.ts`) share it.
 * Whatever a run records stays in the page until the run has ended, so that nothing but the viewer's own traffic crosses the link.
 */

import { effect } from "@preact/signals";
import { KINDS, OFF } from "../enhance/model/enhancer";
import { nameProblem } from "../enhance/registry";
import type { DownloadForm } from "../local/local-player";
import { poseAt, type TimedPose } from "../movement/playback";
import type { About } from "../samples/layout";
import { removeSampledRun } from "../samples/sampled-runs";
import { type Sampled, Sampler } from "../samples/sampler";
import { changeSettings, settings } from "../state/app";
import { type Mode, type Settings, validSettings } from "../state/settings";
import { anyStreamed } from "../state/sides";
import type { ScenePose } from "../view/camera";
import type { PresentedFrame } from "../view/presented";
import type { ViewerSession } from "../viewer/session";
import type { Recording } from "../wire/store";
import { Recorder } from "./recorder";

export interface RunPlan {
  /** In the order of time, in the scene's own frame. */
  readonly points: readonly TimedPose[];
  readonly duration_ms: number;
  /** How often what is on the screen is kept; 0 keeps nothing. */
  readonly capture_every_ms: number;
  /** Of the mode `stateless`: every so many shown frames, one is sampled; 0 samples none. */
  readonly sample_stride: number;
  /** The recording begins with the mode `local`, and so with the download of the scene in this form. */
  readonly download?: DownloadForm | null;
  /** Whose samples they are; without it, only scripts have a use for them. */
  readonly about?: About | null;
}

export interface RunnerState {
  /** Frames come, the newest pose is on the screen, and the models that enhance frames are loaded, or given up. */
  readonly ready: boolean;
  /** Why frames are not enhanced, turned or drawn as was chosen, or were not at some time of the last run; or null. */
  readonly problem: string | null;
  readonly phase: string;
  readonly mode: Mode;
  /** Frames shown since the mode was changed. */
  readonly shown: number;
}

/** When the movement has ended, its last pose is waited for this long, in milliseconds. */
const DRAIN = 5000;
/** A camera that stood for so long while the movement went on has missed some of it: hidden pages get no animation frames. In ms. */
const PAUSE = 1000;
/** Between two frames of any display, in milliseconds: browsers hold a page whose pictures nobody sees back to one a second. */
const SLOWEST_DISPLAY = 100;
const TRAFFIC_EVERY = 250;
/** Spreads the seeds' clocks evenly over an interval. */
const GOLDEN = (Math.sqrt(5) - 1) / 2;

export class Runner {
  readonly #session: ViewerSession;
  readonly #stops: readonly (() => void)[];
  #pictures: (ImageBitmap | null)[] = [];
  #recorder: Recorder | undefined;
  #shown = 0;
  #newest = -1;
  #frame: PresentedFrame | undefined;
  #running = false;
  #sampler: Sampler | null = null;
  #sampled: Sampled | null = null;
  /** Why frames were not turned at some time of the last run, as they were to be. */
  #lapse: string | null = null;

  constructor(session: ViewerSession) {
    this.#session = session;
    this.#stops = [
      session.onPresented((frame) => this.#presented(frame)),
      session.onShown((frame) => this.#sampler?.shown(frame)),
      session.onSent((request) => this.#recorder?.sent(request)),
      session.onReplied((reply) => this.#recorder?.replied(reply)),
    ];
  }

  /** Decides the controllers' random numbers; if it is another one than before, a controller that adapts begins anew. */
  seed(seed: number): void {
    this.#session.seed.value = seed;
  }

  /** Changes settings; the rest stays. Throws if one does not exist or make sense: nothing is measured by mistake. */
  settings(part: Partial<Settings>): void {
    const before = settings.peek();
    const unknown = KINDS.map((kind) => nameProblem(kind, part[kind] ?? OFF)).find((problem) => problem !== null);
    if (unknown) throw new Error(unknown);
    changeSettings(validSettings({ ...before, ...part }));
    this.#lapse = null;
    const now = settings.peek();
    const streamed = [
      "mode",
      "left",
      "right",
      "dashPreset",
      "dashFrameRate",
      "dashRepresentation",
      "localForm",
      "webrtcStream",
    ] as const;
    // A stream is opened anew for these; a mode without one may have no reason to ask for another frame.
    const turned = !anyStreamed(now) ? [] : (["reprojection", "overscan"] as const);
    if ([...streamed, ...turned].some((name) => now[name] !== before[name])) this.#shown = 0; // other frames are waited for
  }

  /** Stand at a pose of the scene's own frame until a run begins, or the camera is released. */
  stand({ position, quaternion }: ScenePose): void {
    this.#session.rig.drive(() => ({ position, quaternion }));
  }

  /** Give the camera back to the person. */
  release(): void {
    this.#session.rig.drive(null);
  }

  state(): RunnerState {
    const { phase, rig, enhancement, local } = this.#session;
    const enhanced = enhancement.status.peek();
    const drawn = local.peek()?.phase.peek();
    const failed = enhanced.kind === "failed" ? enhanced : drawn?.kind === "failed" ? drawn : null;
    const shown = this.#shown > 0 && this.#newest >= rig.pose.seq;
    return {
      ready: phase.peek().kind === "playing" && shown && enhanced.kind !== "starting",
      problem: failed?.message ?? this.#unturned() ?? this.#lapse,
      phase: phase.peek().kind,
      mode: settings.peek().mode,
      shown: this.#shown,
    };
  }

  /** Play a movement and record it; one at a time. If `signal` is aborted, it rejects with its reason. */
  async run(plan: RunPlan, signal?: AbortSignal): Promise<Required<Recording>> {
    if (this.#running) throw new Error("a run is under way");
    this.#running = true;
    this.#forgetPictures();
    const { about = null, sample_stride } = plan;
    try {
      this.#sampler = sample_stride > 0 ? await Sampler.open(about, sample_stride) : null;
      return await this.#record(plan, signal);
    } finally {
      this.#sampled = (await this.#sampler?.finish()) ?? null;
      this.#sampler = null;
      this.#running = false;
    }
  }

  /** A kept picture of the last run, once: whoever takes it closes it. */
  takePicture(index: number): ImageBitmap {
    const picture = this.#pictures[index];
    if (!picture) throw new Error(`there is no picture ${index}`);
    this.#pictures[index] = null;
    return picture;
  }

  /** What became of the samples of the last run; null if there were to be none. */
  get sampled(): Sampled | null {
    return this.#sampled;
  }

  /** Removes the samples of the last run: it has failed, or they have been fetched. */
  async discardSamples(): Promise<void> {
    const key = this.#sampled?.key;
    this.#sampled = null;
    if (key) await removeSampledRun(key);
  }

  dispose(): void {
    for (const stop of this.#stops) stop();
    this.#forgetPictures();
  }

  async #record(
    { points, duration_ms, capture_every_ms, download = null }: RunPlan,
    signal: AbortSignal | undefined,
  ): Promise<Required<Recording>> {
    const { rig } = this.#session;
    const startedAt = await animationFrame();
    this.#sampler?.begin(startedAt);
    const movement = (elapsed: number) => poseAt(points, Math.min(elapsed, duration_ms));
    const recorder = new Recorder({
      startedAt,
      duration: duration_ms,
      movement,
      pose: rig.pose.seq,
      received: this.#session.receivedBytes,
      captureEvery: capture_every_ms,
      captureOffset: capture_every_ms * ((this.#session.seed.peek() * GOLDEN) % 1),
    });
    this.#recorder = recorder;
    if (download !== null) {
      this.settings({ mode: "local", localForm: download });
      this.#frame = undefined; // what the mode before has shown is gone
    }
    let hidden = document.visibilityState === "hidden";
    const onVisibility = () => {
      hidden ||= document.visibilityState === "hidden";
    };
    document.addEventListener("visibilitychange", onVisibility);
    this.#lapse = null;
    const watch = effect(() => {
      this.#lapse ??= this.#unturned();
    });
    try {
      const lens = { ...rig.viewport.peek(), ...rig.intrinsics.peek() };
      const movedUntil = startedAt + duration_ms;
      let sampledAt = startedAt;
      let longestPause = 0;
      rig.drive((now) => {
        recorder.sampled(rig.pose, sampledAt); // the pose of the sample before this one
        if (sampledAt < movedUntil) longestPause = Math.max(longestPause, now - sampledAt);
        sampledAt = now;
        for (let ticks = recorder.due(now); ticks > 0; ticks--) void this.#keep(recorder, now);
        return movement(now - startedAt);
      });
      const targets: number[] = [];
      const noteTarget = effect(() => {
        const target = this.#session.stream.value?.stats.value.targetLatency;
        if (target != null && target !== targets.at(-1)) targets.push(target);
      });
      const endedAt = await this.#ended(recorder, movedUntil, signal).finally(noteTarget);
      const played = this.#session.stream.peek()?.playing ?? null;
      // Drawing a scene may take all of the page's time: that is the mode's own doing, and its poses are counted as missed.
      const animated = (recorder.displayInterval ?? Number.POSITIVE_INFINITY) < SLOWEST_DISPLAY;
      const unbroken = longestPause < PAUSE || (download !== null && !hidden && animated);
      return {
        scene: rig.scene?.id ?? "",
        mode: settings.peek().mode,
        transport: this.#session.connected.peek()?.transport.kind ?? null,
        dash: played && "dash" in played ? { ...played.dash, targets_ms: targets } : null,
        webrtc: played && "webrtc" in played ? played.webrtc : null,
        local: this.#session.local.peek()?.played(startedAt) ?? null,
        user_agent: navigator.userAgent,
        lens,
        started_unix_ms: performance.timeOrigin + startedAt,
        duration_ms,
        ended_ms: endedAt - startedAt,
        complete: sampledAt >= movedUntil && unbroken,
        hidden,
        display_interval_ms: recorder.displayInterval,
        ...recorder.events,
      };
    } finally {
      document.removeEventListener("visibilitychange", onVisibility);
      watch();
      this.#recorder = undefined;
      this.release();
    }
  }

  #unturned(): string | null {
    return this.#session.unturned.value;
  }

  #forgetPictures(): void {
    for (const picture of this.#pictures) picture?.close();
    this.#pictures = [];
  }

  #presented(frame: PresentedFrame): void {
    this.#shown++;
    this.#newest = Math.max(this.#newest, frame.pose);
    this.#frame = frame;
    this.#recorder?.presented(frame);
  }

  /** A copy on the graphics processor, or in memory where there is none: encoding waits until the run has ended. */
  async #keep(recorder: Recorder, at: number): Promise<void> {
    const frame = this.#frame;
    const { stateless, stream, local, rig } = this.#session;
    if (frame === undefined) {
      const picture = await createImageBitmap(new ImageData(rig.viewport.peek().width, rig.viewport.peek().height));
      recorder.capturedNothing(at, picture);
      this.#pictures.push(picture);
      return;
    }
    const sides = { stateless, dash: stream.peek(), webrtc: stream.peek(), local: local.peek() };
    try {
      const picture = await sides[frame.side]?.picture();
      if (!picture) return;
      recorder.captured(frame, at, picture);
      this.#pictures.push(picture);
    } catch {
      // a picture that cannot be had: the next one will do
    }
  }

  /** Resolves when the last pose is on the screen, or nobody waits for it any longer. */
  async #ended(recorder: Recorder, movedUntil: number, signal?: AbortSignal): Promise<number> {
    let reportedAt = Number.NEGATIVE_INFINITY;
    for (;;) {
      const now = await animationFrame();
      signal?.throwIfAborted();
      if (now - reportedAt >= TRAFFIC_EVERY) {
        recorder.received(this.#session.receivedBytes, now);
        reportedAt = now;
      }
      const over = now - movedUntil;
      if (over > DRAIN || (over > 100 && recorder.settled)) return now;
    }
  }
}

function animationFrame(): Promise<number> {
  return new Promise((resolve) => requestAnimationFrame(() => resolve(performance.now())));
}
