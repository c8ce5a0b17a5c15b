/** The modes with one stream per viewer from the packager: its camera follows the rig, and every frame is measured. */

import { signal } from "@preact/signals";
import { deferred } from "#client/async/deferred";
import { retry } from "#client/async/retry";
import { ApiError } from "#client/http/problem";
import type { SessionStatus } from "#client/wire/dash";
import type { Recording } from "#client/wire/store";
import { Foresight } from "../predict/foresight";
import type { PredictorName } from "../predict/registry";
import type { Reprojector } from "../reproject/reprojector";
import { type Figures, Meter, NO_FIGURES, STATS_EVERY } from "../view/meter";
import type { PresentedFrame, Side, SourcePhase } from "../view/presented";
import type { Rig } from "../view/rig";
import { CameraFeed } from "./camera-feed";
import { FramePoses } from "./frame-poses";
import { LatencyTarget } from "./latency-target";
import {
  type OpenViews,
  STREAM_NAMES,
  StreamEnded,
  type StreamKind,
  StreamUnsupported,
  type ViewStream,
} from "./stream";
import { type StreamedFrame, TurnedVideo } from "./turned-video";

export interface StreamStats extends Figures {
  readonly kind: "stream";
  /** Latency behind the live edge in milliseconds, as measured by the player. */
  readonly liveLatency: number | null;
  readonly targetLatency: number | null;
  /** Codec, and time of frames in the jitter buffer in milliseconds; WebRTC only. */
  readonly codec: string | null;
  readonly jitterBuffer: number | null;
}

export const NO_STREAM_STATS: StreamStats = {
  kind: "stream",
  ...NO_FIGURES,
  liveLatency: null,
  targetLatency: null,
  codec: null,
  jitterBuffer: null,
};

export interface StreamOptions {
  readonly video: HTMLVideoElement;
  readonly rig: Rig;
  readonly side: Side & StreamKind;
  readonly open: OpenViews;
  /** Whether stalls raise the target (`latency-target.ts`); otherwise it is constant. */
  readonly adaptive: boolean;
  readonly prediction: () => PredictorName;
  /** Turns the stream's frames to the pose of each animation frame while it works. */
  readonly reprojector: Reprojector<StreamedFrame>;
  /** Margin of frames at each side, as a share of the viewport; null if frames are shown without a warp. */
  readonly overscan: number | null;
  readonly onPresented: (frame: PresentedFrame) => void;
  readonly onReceived: (bytes: number) => void;
}

/** A frame of the video, as reported by the browser. */
interface Shown {
  readonly frame: number;
  readonly at: number;
  readonly width: number;
  readonly height: number;
}

/** A playing stream; `ended` resolves with the reason. */
interface Playing {
  readonly ended: Promise<string>;
}

export class StreamPlayer {
  readonly stats = signal<StreamStats>(NO_STREAM_STATS);
  readonly phase = signal<SourcePhase>({ kind: "connecting" });
  readonly #options: StreamOptions;
  readonly #visit = new AbortController();
  readonly #meter: Meter;
  readonly #foresight: Foresight;
  readonly #feed: CameraFeed;
  /** Null if frames are shown unchanged. */
  readonly #turned: TurnedVideo | null;
  #stream: ViewStream | undefined;
  #target: LatencyTarget | undefined;
  /** Target latencies in milliseconds, with their start times. */
  readonly #targets: { readonly at: number; readonly target: number }[] = [];
  #publishedAt = 0;

  constructor(options: StreamOptions) {
    this.#options = options;
    this.#meter = new Meter(options.side, options.onPresented);
    const { rig, prediction, overscan, video, reprojector } = options;
    this.#foresight = new Foresight(rig, prediction);
    this.#feed = new CameraFeed({ rig, foresight: this.#foresight, overscan });
    this.#turned = overscan === null ? null : new TurnedVideo(video, reprojector);
    video.style.scale = String(1 + 2 * (overscan ?? 0)); // the margins extend beyond the pane until a frame is warped
    void this.#run(this.#visit.signal);
  }

  dispose(): void {
    this.#visit.abort();
    this.#leave();
  }

  /** The current stream, for records, with the target latencies since a time; empty without one. */
  played(startedAt: number): Partial<Pick<Recording, "dash" | "webrtc">> {
    const played = this.#stream?.played;
    if (played === undefined || "webrtc" in played) return played ?? {};
    const later = this.#targets.filter(({ at }) => at > startedAt);
    const before = this.#targets.slice(0, this.#targets.length - later.length).slice(-1);
    return { dash: { ...played.dash, targets_ms: [...before, ...later].map(({ target }) => target) } };
  }

  /** The packager's report on the stream; null if unavailable. */
  async status(signal: AbortSignal): Promise<SessionStatus | null> {
    return this.#stream?.status(signal) ?? null;
  }

  picture(): Promise<ImageBitmap> {
    return this.#options.reprojector.picture() ?? createImageBitmap(this.#options.video);
  }

  presented(now: number): void {
    const turned = this.#options.reprojector.presented();
    if (turned === null || this.#turned === null) return;
    const { pose, view, filled, warpMs, fresh } = turned;
    const { askedAt, ...frame } = turned.frame;
    if (fresh) this.#foresight.shown(askedAt, now);
    this.#meter.presented({ at: now, pose, view, filled, warpMs, ...frame }, fresh);
  }

  resumed(gap: number): void {
    this.#meter.resumed(gap);
    this.#foresight.reset();
    this.#target?.forget();
    this.#options.reprojector.resumed();
  }

  tick(now: number, moved: boolean): void {
    const { rig, reprojector } = this.#options;
    this.#meter.sampled(rig.pose.seq, now);
    // Until the stream plays, poses wait for its start, which is not latency.
    if (moved && this.phase.peek().kind === "playing") this.#meter.moved(rig.pose.seq, now);
    this.#feed.follow(now, (update) => this.#stream?.send(update) ?? false);
    const lens = { ...rig.intrinsics.peek(), ...rig.viewport.peek() };
    if (this.#turned) reprojector.turn(this.#foresight.onScreen(now), lens);
    if (now - this.#publishedAt < STATS_EVERY) return;
    this.#publishedAt = now;
    const seconds = this.#stream?.latency() ?? null;
    const target = this.#target?.value ?? this.#stream?.targetLatency ?? null;
    if (target !== null && target !== this.#targets.at(-1)?.target) this.#targets.push({ at: now, target });
    const receiver = this.#stream?.receiver();
    this.stats.value = {
      kind: "stream",
      ...this.#meter.figures(now),
      buffered: receiver?.jitterBuffer ?? bufferedMs(this.#options.video),
      liveLatency: seconds === null ? null : seconds * 1000,
      targetLatency: target,
      codec: receiver?.codec ?? null,
      jitterBuffer: receiver?.jitterBuffer ?? null,
      warpMs: reprojector.warpMs(now),
      gpuMs: reprojector.gpuMs,
    };
  }

  /** Plays one stream after another, until the visit ends. */
  async #run(signal: AbortSignal): Promise<void> {
    try {
      while (!signal.aborted) {
        const { ended } = await retry(() => this.#start(signal), {
          minTimeout: 300,
          maxTimeout: 4000,
          factor: 1.6,
          signal,
          shouldRetry: (error) => error instanceof StreamEnded || (error instanceof ApiError && error.unreachable),
          onFailedAttempt: (error) => this.#lost(error instanceof Error ? error.message : String(error), signal),
        });
        this.#lost(await ended, signal);
      }
    } catch (error) {
      if (signal.aborted) return;
      this.#leave();
      const known = error instanceof ApiError || error instanceof StreamUnsupported;
      const unknown = `This browser cannot play the ${STREAM_NAMES[this.#options.side]} stream.`;
      this.phase.value = { kind: "failed", message: known ? error.message : unknown };
    }
  }

  #lost(message: string, signal: AbortSignal): void {
    if (signal.aborted) return;
    this.#leave();
    this.phase.value = { kind: "lost", message };
  }

  /** Opens a stream; resolves when its first frame is on the screen. */
  async #start(signal: AbortSignal): Promise<Playing> {
    const { video, open, adaptive, onReceived } = this.#options;
    const playing = deferred<undefined>();
    const ended = deferred<string>();
    const attempt = new AbortController();
    signal.addEventListener("abort", () => ended.resolve(""), { signal: attempt.signal });
    void ended.promise.then(() => attempt.abort());
    const frames = new FramePoses<Shown>((message, shown) => this.#present(message, shown));
    const events = {
      told: (frame: number, pose: number) => frames.told(frame, pose),
      received: (bytes: number) => {
        this.#meter.received(bytes, performance.now());
        onReceived(bytes);
      },
      failed: ended.resolve,
    };
    const stream = await open(video, this.#feed.open(performance.now()), events, signal).catch((error: unknown) => {
      attempt.abort();
      throw error;
    });
    if (signal.aborted) stream.dispose();
    signal.throwIfAborted();
    this.#foresight.reset();
    this.#meter.reset();
    this.#stream = stream;
    const target = adaptive && stream.targetLatency !== null ? new LatencyTarget(stream.targetLatency) : undefined;
    this.#target = target;
    const presented: VideoFrameRequestCallback = (_, metadata) => {
      if (this.#stream !== stream) return;
      video.requestVideoFrameCallback(presented);
      if (this.phase.peek().kind !== "playing") this.phase.value = { kind: "playing" };
      playing.resolve(undefined);
      const { mediaTime, expectedDisplayTime, width, height } = metadata;
      if (target?.presented(expectedDisplayTime, mediaTime)) stream.aim(target.value);
      const captured = this.#turned?.capture(mediaTime, (time) => stream.frame(time, metadata));
      const frame = captured ?? stream.frame(mediaTime, metadata);
      if (frame !== null) frames.presented(frame, { frame, at: expectedDisplayTime, width, height });
    };
    video.requestVideoFrameCallback(presented);
    const early = await Promise.race([playing.promise, ended.promise]);
    if (early !== undefined) throw new StreamEnded(early);
    return { ended: ended.promise };
  }

  /** Presents a frame of the video, once its message is known. */
  #present(message: number, { frame, at, width, height }: Shown): void {
    const rung = this.#stream?.rung(width, height) ?? null;
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
    this.#stream?.dispose();
    this.#stream = this.#target = undefined;
  }
}

/** Buffered time ahead of the current frame in milliseconds; null before the first frame. */
function bufferedMs({ buffered, currentTime }: HTMLVideoElement): number | null {
  if (buffered.length === 0) return null;
  return Math.max(0, (buffered.end(buffered.length - 1) - currentTime) * 1000);
}
