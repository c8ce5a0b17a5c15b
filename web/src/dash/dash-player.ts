/** The DASH mode: a stream of one's own from the packager, whose camera follows the rig, measured frame by frame. */

import { signal } from "@preact/signals";
import pRetry from "p-retry";
import { deferred } from "../async/deferred";
import { ApiError } from "../http/problem";
import type { Intrinsics, Viewport } from "../view/intrinsics";
import { type Figures, Meter, NO_FIGURES, STATS_EVERY } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import type { Rig } from "../view/rig";
import type { FrameShown, SessionInfo, SessionRequest } from "../wire/dash";
import type { PlayedStream } from "../wire/store";
import { endSession, openPoseSocket, openSession, type PoseSocket } from "./api";
import { FramePoses } from "./frame-poses";
import { LatencyTarget } from "./latency-target";
import type { DashPlan } from "./presets";
import { type PlayStream, type Stream, StreamEnded, StreamUnsupported } from "./streaming";

export interface DashStats extends Figures {
  /** Behind the live edge, in milliseconds, as the player counts. */
  readonly liveLatency: number | null;
  /** What it is to be, in milliseconds. */
  readonly targetLatency: number | null;
}

export const NO_DASH_STATS: DashStats = { ...NO_FIGURES, liveLatency: null, targetLatency: null };

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
  readonly onPresented: (frame: PresentedFrame) => void;
  /** Bytes of segments came in. */
  readonly onReceived: (bytes: number) => void;
  readonly now: () => number;
}

/** A frame of the video, as the browser told of it. */
interface Shown {
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
  #session: SessionInfo | undefined;
  #poses: PoseSocket | undefined;
  #stream: Stream | undefined;
  #target: LatencyTarget | undefined;
  /** The pose and the lens that the packager was told last. */
  #sent: { readonly seq: number; readonly lens: Intrinsics | undefined } | undefined;
  readonly #viewport: Viewport;
  #publishedAt = 0;

  constructor(options: DashOptions) {
    this.#options = options;
    this.#meter = new Meter("dash", options.onPresented);
    this.#viewport = options.rig.viewport.peek();
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

  /** Once per animation frame, after the rig was sampled; `moved` is what the rig said. */
  tick(now: number, moved: boolean): void {
    const { rig } = this.#options;
    // Until the stream plays, poses wait for its start: that is no latency.
    if (moved && this.phase.peek().kind === "playing") this.#meter.moved(rig.pose.seq, now);
    this.#follow();
    if (now - this.#publishedAt < STATS_EVERY) return;
    this.#publishedAt = now;
    const seconds = this.#stream?.latency() ?? null;
    this.stats.value = {
      ...this.#meter.figures(now),
      liveLatency: seconds === null ? null : seconds * 1000,
      targetLatency: this.targetLatency,
    };
  }

  /** Tells the packager of a new pose or lens. A lens for another viewport is not one for this stream. */
  #follow(): void {
    const { rig } = this.#options;
    const { pose } = rig;
    const lens = rig.viewport.peek() === this.#viewport ? rig.intrinsics.peek() : undefined;
    if (pose.seq === this.#sent?.seq && lens === this.#sent.lens) return;
    if (this.#poses?.send({ ...pose, ...lens })) this.#sent = { seq: pose.seq, lens };
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
    const { rig, base, scene, plan, stamp } = this.#options;
    const { position, quaternion } = rig.pose;
    // Unless there is to be only one, the representations are the packager's choice: it knows the ladder and the viewport.
    const request: SessionRequest = {
      scene,
      position,
      quaternion,
      ...rig.intrinsics.value,
      ...rig.viewport.value,
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
      const frames = new FramePoses<Shown>((pose, shown) => this.#present(session, pose, shown));
      this.#sent = undefined;
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
        frames.presented(Math.round(mediaTime * session.frame_rate), { at: expectedDisplayTime, width, height });
      };
      video.requestVideoFrameCallback(presented);
    });
  }

  #present({ representations }: SessionInfo, pose: number, { at, width, height }: Shown): void {
    const rung = representations.find((one) => one.width === width && one.height === height)?.rung ?? null;
    this.#meter.presented({ at, pose, rung, width, height });
  }

  #leave(): void {
    this.#poses?.close();
    this.#stream?.dispose();
    if (this.#session) endSession(this.#options.base, this.#session);
    this.#poses = this.#stream = this.#session = this.#target = undefined;
  }
}
