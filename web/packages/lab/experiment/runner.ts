/**
 * Plays a movement in the viewer and records it, for scripts (`bridge.ts`) and the page's experiments (`perform.ts`).
 * The record stays in the page until the run has ended, so that only the viewer's own traffic crosses the link.
 */

import { effect } from "@preact/signals";
import type { Recording } from "#client/wire/store";
import { KINDS, OFF } from "#viewer/enhance/model/enhancer";
import { nameProblem } from "#viewer/enhance/registry";
import { poseAt, type TimedPose } from "#viewer/movement/movement";
import { turning } from "#viewer/reproject/acceleration";
import type { ViewerSession } from "#viewer/session/session";
import { kindsShown, reopens } from "#viewer/sources/sides";
import { type Mode, type Settings, validSettings } from "#viewer/state/settings";
import type { ScenePose } from "#viewer/view/camera";
import type { PresentedFrame } from "#viewer/view/presented";
import type { About } from "../samples/layout";
import { removeSampledRun } from "../samples/sampled-runs";
import { type Sampled, Sampler } from "../samples/sampler";
import { RunFailed } from "./errors";
import { intervalAtRest, Recorder } from "./recorder";

export interface RunPlan {
  /** In order of time, in the scene's own frame. */
  readonly points: readonly TimedPose[];
  readonly duration_ms: number;
  /** Interval of capturing the screen; 0 captures nothing. */
  readonly capture_every_ms: number;
  /** For the mode `stateless`: every nth shown frame is sampled; 0 samples none. */
  readonly sample_stride: number;
  /** Whether the recording begins with the mode `local`, and so with the download of the scene. */
  readonly download?: boolean;
  /** The run that the samples belong to; absent for scripts. */
  readonly about?: About | null;
}

export interface RunnerState {
  /** Frames arrive, the newest pose is on the screen, and the models that enhance frames are loaded or have failed. */
  readonly ready: boolean;
  /** Why frames are not enhanced, turned or drawn as chosen, or were not at some time during the last run; or null. */
  readonly problem: string | null;
  readonly phase: string;
  readonly mode: Mode;
  /** Frames shown since the mode was changed. */
  readonly shown: number;
}

/** Longest wait for the last pose after the end of the movement, in milliseconds. */
const DRAIN = 5000;
/**
 * A camera that stood still for this many milliseconds during a movement has missed a part of it: hidden pages get no
 * animation frames.
 */
const PAUSE = 1000;
/** Longest frame interval of any display, in milliseconds: browsers throttle hidden pages to one frame per second. */
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
  /** The display's frame interval in milliseconds, measured at rest; the shortest of the page's lifetime. */
  #atRest: number | null = null;
  /** Times of the animation frames since the camera came to rest. */
  #stood: number[] = [];
  #newest = -1;
  #frame: PresentedFrame | undefined;
  #running = false;
  #sampler: Sampler | null = null;
  #sampled: Sampled | null = null;
  /** Reason why frames of the last run were not warped as configured. */
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

  /** Sets the seed of the controllers' random numbers; a different one restarts an adaptive controller. */
  seed(seed: number): void {
    this.#session.seed.value = seed;
  }

  /** Changes settings. Throws if one is unknown or invalid, so that nothing is measured by mistake. */
  settings(part: Partial<Settings>): void {
    const { settings, change } = this.#session.state;
    const before = settings.peek();
    const unknown = KINDS.map((kind) => nameProblem(kind, part[kind] ?? OFF)).find((problem) => problem !== null);
    if (unknown) throw new Error(unknown);
    change(validSettings({ ...before, ...part }));
    const forces = part.reprojection === true && turning.peek() !== "forced";
    if (forces) turning.value = "forced"; // requested settings are measured even without graphics acceleration
    this.#lapse = null;
    const now = settings.peek();
    const forced = forces && kindsShown(now).some((kind) => kind.reopens.includes("reprojection"));
    if (forced || reopens(before, now)) this.#shown = 0; // wait for other frames
  }

  /** Reconnects, so that knowledge of the network from before a run does not influence the run. */
  reconnect(): void {
    this.#session.retry();
    this.#shown = 0;
  }

  /** Holds a pose in the scene's own frame until a run begins, or the camera is released. */
  stand({ position, quaternion }: ScenePose): void {
    this.#stood = [];
    this.#session.rig.drive((now) => {
      this.#stood.push(now);
      return { position, quaternion };
    });
  }

  release(): void {
    this.#session.rig.drive(null);
  }

  state(): RunnerState {
    const { phase, rig, source } = this.#session;
    const enhanced = source.peek()?.enhancement?.status.peek() ?? { kind: "off" };
    const drawn = source.peek()?.phase.peek();
    const failed = enhanced.kind === "failed" ? enhanced : drawn?.kind === "failed" ? drawn : null;
    const shown = this.#shown > 0 && this.#newest >= rig.pose.seq;
    return {
      ready: phase.peek().kind === "playing" && shown && enhanced.kind !== "starting",
      problem: failed?.message ?? this.#unturned() ?? this.#lapse,
      phase: phase.peek().kind,
      mode: this.#session.state.settings.peek().mode,
      shown: this.#shown,
    };
  }

  /**
   * Plays and records a movement; one at a time. A connection or stream that is lost for a while is part of the record.
   * Rejects with a RunFailed if it fails for good, or with the reason of `signal`.
   */
  async run(plan: RunPlan, signal?: AbortSignal): Promise<Required<Recording>> {
    if (this.#running) throw new Error("a run is already in progress");
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

  /** A captured picture of the last run as a PNG; it is then dropped. */
  async takePicture(index: number): Promise<Blob> {
    const picture = this.#pictures[index];
    if (!picture) throw new Error(`there is no picture ${index}`);
    this.#pictures[index] = null;
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    canvas.getContext("2d")?.drawImage(picture, 0, 0);
    picture.close();
    return canvas.convertToBlob({ type: "image/png" });
  }

  /** Outcome of the last run's samples; null if none were requested. */
  get sampled(): Sampled | null {
    return this.#sampled;
  }

  /** Removes the samples of the last run, after it has failed or they have been fetched. */
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
    { points, duration_ms, capture_every_ms, download = false }: RunPlan,
    signal: AbortSignal | undefined,
  ): Promise<Required<Recording>> {
    const { rig } = this.#session;
    const startedAt = await animationFrame();
    const atRest = intervalAtRest(this.#stood);
    if (atRest !== null) this.#atRest = Math.min(atRest, this.#atRest ?? atRest);
    this.#sampler?.begin(startedAt);
    const movement = (elapsed: number) => poseAt(points, Math.min(elapsed, duration_ms));
    const recorder = new Recorder({
      startedAt,
      duration: duration_ms,
      movement,
      atRest: this.#atRest,
      pose: rig.pose.seq,
      received: this.#session.receivedBytes,
      captureEvery: capture_every_ms,
      captureOffset: capture_every_ms * ((this.#session.seed.peek() * GOLDEN) % 1),
    });
    this.#recorder = recorder;
    if (download) {
      this.settings({ mode: "local" });
      this.#frame = undefined; // the previous mode's picture is removed
    }
    let hidden = document.visibilityState === "hidden";
    const onVisibility = () => {
      hidden ||= document.visibilityState === "hidden";
    };
    document.addEventListener("visibilitychange", onVisibility);
    this.#lapse = null;
    const over = new AbortController();
    const watch = effect(() => {
      this.#lapse ??= this.#unturned();
      const failure = this.#failure();
      if (failure !== null) over.abort(new RunFailed(failure));
    });
    try {
      const lens = { ...rig.viewport.peek(), ...rig.intrinsics.peek() };
      const movedUntil = startedAt + duration_ms;
      let sampledAt = startedAt;
      let longestPause = 0;
      rig.drive((now) => {
        recorder.sampled(rig.pose, sampledAt); // the previous sample's pose
        if (sampledAt < movedUntil) longestPause = Math.max(longestPause, now - sampledAt);
        sampledAt = now;
        for (let ticks = recorder.due(now); ticks > 0; ticks--) void this.#keep(recorder, now);
        return movement(now - startedAt);
      });
      const ending = signal ? AbortSignal.any([signal, over.signal]) : over.signal;
      const endedAt = await this.#ended(recorder, movedUntil, ending);
      // Drawing a scene may take all of the page's time: this is a property of the mode, and the poses count as missed.
      const animated = (recorder.animationInterval ?? Number.POSITIVE_INFINITY) < SLOWEST_DISPLAY;
      const unbroken = longestPause < PAUSE || (download && !hidden && animated);
      return {
        scene: rig.scene?.id ?? "",
        mode: this.#session.state.settings.peek().mode,
        transport: this.#session.connected.peek()?.transport.kind ?? null,
        ...this.#played(startedAt),
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

  /** Why a run can get no more pictures, in one sentence; null while it can. */
  #failure(): string | null {
    const { phase, source } = this.#session;
    const shown = source.value?.phase.value;
    const failed = [phase.value, shown].find((one) => one?.kind === "failed");
    return failed !== undefined && "message" in failed ? (failed.message ?? null) : null;
  }

  /** Figures of the streams and downloads on the stage. */
  #played(startedAt: number): Pick<Required<Recording>, "dash" | "webrtc" | "local"> {
    const sources = this.#session.sources.peek();
    return Object.assign({ dash: null, webrtc: null, local: null }, ...sources.map((one) => one.played?.(startedAt)));
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

  /** Copies the picture on the GPU, or in memory without a GPU; it is encoded after the run has ended. */
  async #keep(recorder: Recorder, at: number): Promise<void> {
    const frame = this.#frame;
    const { left, rig } = this.#session;
    if (frame === undefined) {
      const picture = await createImageBitmap(new ImageData(rig.viewport.peek().width, rig.viewport.peek().height));
      recorder.capturedNothing(at, picture);
      this.#pictures.push(picture);
      return;
    }
    try {
      const picture = await left.picture();
      if (!picture) return;
      recorder.captured(frame, at, picture);
      this.#pictures.push(picture);
    } catch {
      // a missing picture: the next one will do
    }
  }

  /** Resolves when the last pose is on the screen, or the wait times out. */
  async #ended(recorder: Recorder, movedUntil: number, signal: AbortSignal): Promise<number> {
    let reportedAt = Number.NEGATIVE_INFINITY;
    for (;;) {
      const now = await animationFrame();
      signal.throwIfAborted();
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
