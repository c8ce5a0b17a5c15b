/** The DASH mode: a stream of one's own from the packager, whose camera follows the rig, measured frame by frame. */

import { signal } from "@preact/signals";
import pRetry from "p-retry";
import { deferred } from "../async/deferred";
import { ApiError } from "../http/problem";
import { Foresight } from "../predict/foresight";
import type { PredictorName } from "../predict/registry";
import type { Reprojector } from "../reproject/reprojector";
import { type Figures, Meter, NO_FIGURES, STATS_EVERY } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import type { Rig } from "../view/rig";
import type { FrameShown, SessionInfo, SessionRequest } from "../wire/dash";
import type { PlayedStream } from "../wire/store";
import { endSession, openPoseSocket, openSession, type PoseSocket } from "./api";
import { CameraFeed } from "./camera-feed";
import { FramePoses } from "./frame-poses";
import { LatencyTarget } from "./latency-target";
import type { DashPlan } from "./presets";
import { type PlayStream, type Stream, StreamEnded, StreamUnsupported } from "./streaming";
import { type StreamedFrame, TurnedVideo } from "./turned-video";

export interface DashStats extends Figures {
  /** Behind the live edge, in milliseconds, as the player counts. */
  readonly liveLatency: number | null;
  /** What it is to be, in milliseconds. */
  readonly targetLatency: number | null;
  /** The main thread's time to turn a picture, median of the last seconds; null while none is turned. In milliseconds. */
  readonly warpMs: number | null;
  /** The graphics processor's time, in milliseconds; null where it does not tell. */
  readonly gpuMs: number | null;
}

export const NO_DASH_STATS: DashStats = {
  ...NO_FIGURES,
  liveLatency: null,
  targetLatency: null,
  warpMs: null,
  gpuMs: null,
};

/** A page that nobody has looked at for so long gives its stream up, in milliseconds; it comes back with who looks again. */
const HIDDEN_FOR = 10_000;

/** How it stands; `failed` waits for another setting. */
export type DashPhase =
  | { readonly kind: "connecting" }
  | { readonly kind: "playing" }
  | { readonly kind: "lost"; readonly message: string }
  | { readonly kind: "failed"; readonly message: string };

export interface DashOptions {
  readonly video: HTMLVideoElement;
  readonly rig: Rig;
  /** Where the packager is. */
  readonly base: string;
  readonly scene: string;
  readonly plan: DashPlan;
  readonly stamp: boolean;
  /** What foretells the poses that the packager is told. */
  readonly prediction: () => PredictorName;
  /** Turns the stream's frames to the pose of each animation frame while it works. */
  readonly reprojector: Reprojector<StreamedFrame>;
  /** How much more frames show at each side, as a share of the viewport; null: they are shown as they come. */
  readonly overscan: number | null;
  readonly onPresented: (frame: PresentedFrame) => void;
  /** Bytes of segments came in. */
  readonly onReceived: (bytes: number) => void;
  readonly now: () => number;
}

/** A frame of the video, as the browser told of it. */
interface Shown {
  /** Its number. */
  readonly frame: number;
  readonly at: number;
  readonly width: number;
  readonly height: number;
}

/** A stream that plays; `ended` resolves with the reason. */
interface Playing {
  readonly ended: Promise<string>;
}

export class DashPlayer {
  readonly stats = signal<DashStats>(NO_DASH_STATS);
  readonly phase = signal<DashPhase>({ kind: "connecting" });
  readonly #options: DashOptions;
  /** Ends with the player, and while the page is hidden; then there is a new one. */
  #visit = new AbortController();
  #hiding: ReturnType<typeof setTimeout> | undefined;
  readonly #meter: Meter;
  readonly #foresight: Foresight;
  readonly #feed: CameraFeed;
  /** Null: frames are shown as they come. */
  readonly #turned: TurnedVideo | null;
  #session: SessionInfo | undefined;
  #poses: PoseSocket | undefined;
  #stream: Stream | undefined;
  #target: LatencyTarget | undefined;
  #publishedAt = 0;

  constructor(options: DashOptions) {
    this.#options = options;
    this.#meter = new Meter("dash", options.onPresented);
    const { rig, prediction, overscan, video, reprojector } = options;
    this.#foresight = new Foresight(rig, prediction);
    this.#feed = new CameraFeed({ rig, foresight: this.#foresight, overscan });
    this.#turned = overscan === null ? null : new TurnedVideo(video, reprojector);
    video.style.scale = String(1 + 2 * (overscan ?? 0)); // until a frame is turned, its margins lie beyond the pane
    void this.#run(this.#visit.signal);
    this.#visibilityChanged();
    document.addEventListener("visibilitychange", this.#visibilityChanged);
  }

  dispose(): void {
    document.removeEventListener("visibilitychange", this.#visibilityChanged);
    clearTimeout(this.#hiding);
    this.#visit.abort();
    this.#leave();
  }

  /** Motion-to-photon latencies of the last seconds, in milliseconds. */
  latencies(now: number): readonly number[] {
    return this.#meter.latencies(now);
  }

  /** The stream that plays, for records; null while there is none. */
  get playing(): Omit<PlayedStream, "targets_ms"> | null {
    if (!this.#stream || !this.#session) return null;
    const { id: _, manifest: __, poses: ___, ...stream } = this.#session;
    return { ...stream, player: this.#stream.player };
  }

  /** The latency that the stream is to have at present, in milliseconds; null while there is none. */
  get targetLatency(): number | null {
    return this.#target?.value ?? this.#session?.target_latency_ms ?? null;
  }

  /** A copy of what is on the screen. */
  picture(): Promise<ImageBitmap> {
    return this.#options.reprojector.picture() ?? createImageBitmap(this.#options.video);
  }

  /** Once per animation frame, first of all: what was turned in the last one is on the screen by now. */
  presented(now: number): void {
    const turned = this.#options.reprojector.presented();
    if (turned === null || this.#turned === null) return;
    const { pose, view, filled, warpMs, fresh } = turned;
    const { askedAt, ...frame } = turned.frame;
    if (fresh) this.#foresight.shown(askedAt, now);
    this.#meter.presented({ at: now, pose, view, filled, warpMs, ...frame }, fresh);
  }

  /** Once per animation frame, after the rig was sampled; `moved` is what the rig said. */
  tick(now: number, moved: boolean): void {
    const { rig, reprojector } = this.#options;
    this.#meter.sampled(rig.pose.seq, now);
    // Until the stream plays, poses wait for its start: that is no latency.
    if (moved && this.phase.peek().kind === "playing") this.#meter.moved(rig.pose.seq, now);
    this.#feed.follow(now, (update) => this.#poses?.send(update) ?? false);
    const lens = { ...rig.intrinsics.peek(), ...rig.viewport.peek() };
    if (this.#turned) reprojector.turn(this.#foresight.onScreen(now), lens);
    if (now - this.#publishedAt < STATS_EVERY) return;
    this.#publishedAt = now;
    const seconds = this.#stream?.latency() ?? null;
    this.stats.value = {
      ...this.#meter.figures(now),
      liveLatency: seconds === null ? null : seconds * 1000,
      targetLatency: this.targetLatency,
      warpMs: reprojector.warpMs(now),
      gpuMs: reprojector.gpuMs,
    };
  }

  readonly #visibilityChanged = (): void => {
    clearTimeout(this.#hiding);
    this.#target?.forget();
    if (document.hidden) this.#hiding = setTimeout(() => this.#pause(), HIDDEN_FOR);
    else if (this.#visit.signal.aborted) {
      this.#visit = new AbortController();
      void this.#run(this.#visit.signal);
    }
  };

  #pause(): void {
    this.#visit.abort();
    this.#leave();
    this.phase.value = { kind: "connecting" };
  }

  /** Plays stream after stream, until the visit ends. */
  async #run(signal: AbortSignal): Promise<void> {
    try {
      while (!signal.aborted) {
        const { ended } = await pRetry(() => this.#start(signal), {
          retries: Number.POSITIVE_INFINITY,
          minTimeout: 300,
          maxTimeout: 4000,
          factor: 1.6,
          randomize: true,
          signal,
          shouldRetry: ({ error }) =>
            !signal.aborted && (error instanceof StreamEnded || (error instanceof ApiError && error.unreachable)),
          onFailedAttempt: ({ error }) => this.#lost(error.message, signal),
        });
        this.#lost(await ended, signal);
      }
    } catch (error) {
      if (signal.aborted) return;
      this.#leave();
      const known = error instanceof ApiError || error instanceof StreamUnsupported;
      this.phase.value = { kind: "failed", message: known ? error.message : "The DASH stream cannot be played here." };
    }
  }

  #lost(message: string, signal: AbortSignal): void {
    if (signal.aborted) return;
    this.#leave();
    this.phase.value = { kind: "lost", message };
  }

  /** Opens a session; resolves when its first frame is on the screen. */
  async #start(signal: AbortSignal): Promise<Playing> {
    const { playStream } =
      this.#options.plan.player === "mse" ? await import("./mse-stream") : await import("./dashjs-stream");
    const session = await this.#open(signal);
    if (signal.aborted) endSession(this.#options.base, session);
    signal.throwIfAborted();
    this.#session = session;
    const playing = deferred<undefined>();
    const ended = this.#play(playStream, session, signal, () => playing.resolve(undefined));
    const early = await Promise.race([playing.promise, ended]);
    if (early !== undefined) throw new StreamEnded(early);
    return { ended };
  }

  #open(signal: AbortSignal): Promise<SessionInfo> {
    const { base, scene, plan, stamp, now } = this.#options;
    // Unless there is to be only one, the representations are the packager's choice: it knows the ladder and the viewport.
    const request: SessionRequest = {
      scene,
      ...this.#feed.open(now()),
      ...plan.setup,
      ...(plan.representation && { representations: [plan.representation] }),
      stamp,
    };
    return openSession(base, request, signal);
  }

  /** Plays a session until it ends; tells why. */
  #play(playStream: PlayStream, session: SessionInfo, signal: AbortSignal, onPlaying: () => void): Promise<string> {
    const { video, base, plan, now, onReceived } = this.#options;
    return new Promise((resolve) => {
      signal.addEventListener("abort", () => resolve(""), { once: true });
      const frames = new FramePoses<Shown>((message, shown) => this.#present(session, message, shown));
      this.#foresight.reset();
      this.#meter.reset();
      this.#poses = openPoseSocket(
        base,
        session,
        ({ frame, pose }: FrameShown) => frames.told(frame, pose),
        () => resolve("The DASH stream was interrupted."),
      );
      this.#stream = playStream(video, `${base}${session.manifest}`, {
        received: (bytes) => {
          this.#meter.received(bytes, now());
          onReceived(bytes);
        },
        failed: resolve,
      });
      const stream = this.#stream;
      const target = plan.adaptive ? new LatencyTarget(session.target_latency_ms) : undefined;
      this.#target = target;
      const presented: VideoFrameRequestCallback = (_, { mediaTime, expectedDisplayTime, width, height }) => {
        if (this.#stream !== stream) return;
        video.requestVideoFrameCallback(presented);
        if (this.phase.peek().kind !== "playing") this.phase.value = { kind: "playing" };
        onPlaying();
        if (target?.presented(expectedDisplayTime, mediaTime)) stream.aim(target.value);
        const captured = this.#turned?.capture(session.frame_rate);
        const frame = captured ?? Math.round(mediaTime * session.frame_rate);
        frames.presented(frame, { frame, at: expectedDisplayTime, width, height });
      };
      video.requestVideoFrameCallback(presented);
    });
  }

  /** It is known of which message a frame of the video is. */
  #present({ representations }: SessionInfo, message: number, { frame, at, width, height }: Shown): void {
    const rung = representations.find((one) => one.width === width && one.height === height)?.rung ?? null;
    const told = this.#feed.told(message);
    if (this.#turned) {
      if (told) this.#turned.show(frame, told, { rung, width, height });
      return;
    }
    if (told) this.#foresight.shown(told.at, at);
    this.#meter.presented({ at, pose: told?.pose ?? message, rung, width, height });
  }

  #leave(): void {
    this.#turned?.clear();
    this.#poses?.close();
    this.#stream?.dispose();
    if (this.#session) endSession(this.#options.base, this.#session);
    this.#poses = this.#stream = this.#session = this.#target = undefined;
  }
}
