/** The DASH mode: a stream of one's own from the packager, whose camera follows the rig, measured frame by frame. */
import { signal } from "@preact/signals";
import pRetry from "p-retry";
import type { FrameShown, SessionInfo, SessionRequest } from "../dash-wire";
import { type Figures, Meter, NO_FIGURES } from "../player/meter";
import { STATS_EVERY } from "../player/player";
import type { PresentedFrame } from "../player/presented";
import type { Rig } from "../player/rig";
import { ApiError } from "../state/api";
import { endSession, openPoses, openSession, type PoseSocket } from "./api";
import { FramePoses } from "./frame-poses";
import type { DashSetup } from "./presets";
import type { Stream } from "./stream";

export interface DashStats extends Figures {
  /** Behind the live edge, in milliseconds, as dash.js counts. */
  readonly liveLatency: number | null;
}

export const NO_DASH_STATS: DashStats = { ...NO_FIGURES, liveLatency: null };

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
  readonly setup: DashSetup;
  /** The rungs that become representations. */
  readonly rungs: readonly number[];
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

export class DashPlayer {
  readonly stats = signal<DashStats>(NO_DASH_STATS);
  readonly phase = signal<DashPhase>({ kind: "connecting" });
  readonly #options: DashOptions;
  readonly #closing = new AbortController();
  readonly #meter: Meter;
  #session: SessionInfo | undefined;
  #poses: PoseSocket | undefined;
  #stream: Stream | undefined;
  #sent = -1;
  #publishedAt = 0;

  constructor(options: DashOptions) {
    this.#options = options;
    this.#meter = new Meter("dash", options.onPresented);
    void this.#run();
  }

  dispose(): void {
    this.#closing.abort();
    this.#leave();
  }

  /** Motion-to-photon latencies of the last seconds, in milliseconds. */
  latencies(now: number): readonly number[] {
    return this.#meter.latencies(now);
  }

  /** Once per animation frame, after the rig was sampled; `moved` is what the rig said. */
  tick(now: number, moved: boolean): void {
    const { rig } = this.#options;
    if (this.#stream && moved) this.#meter.moved(rig.pose.seq, now);
    if (rig.pose.seq !== this.#sent && this.#poses?.send({ ...rig.pose, ...rig.intrinsics.value })) {
      this.#sent = rig.pose.seq;
    }
    if (now - this.#publishedAt < STATS_EVERY) return;
    this.#publishedAt = now;
    const seconds = this.#stream?.latency() ?? null;
    this.stats.value = { ...this.#meter.figures(now), liveLatency: seconds === null ? null : seconds * 1000 };
  }

  /** Opens stream after stream, until it is disposed of. */
  async #run(): Promise<void> {
    const { signal } = this.#closing;
    while (!signal.aborted) {
      try {
        this.#session = await pRetry(() => this.#open(), {
          retries: Number.POSITIVE_INFINITY,
          minTimeout: 300,
          maxTimeout: 4000,
          factor: 1.6,
          randomize: true,
          signal,
          shouldRetry: ({ error }) => !signal.aborted && error instanceof ApiError && error.unreachable,
          onFailedAttempt: ({ error }) => {
            if (!signal.aborted) this.phase.value = { kind: "lost", message: error.message };
          },
        });
        const reason = await this.#play(this.#session);
        this.#leave();
        if (!signal.aborted) this.phase.value = { kind: "lost", message: reason };
      } catch (error) {
        if (signal.aborted) return;
        const message = error instanceof ApiError ? error.message : "The DASH stream cannot be played here.";
        this.phase.value = { kind: "failed", message };
        return;
      }
    }
  }

  #open(): Promise<SessionInfo> {
    const { rig, base, scene, setup, rungs, stamp } = this.#options;
    const { position, quaternion } = rig.pose;
    const request: SessionRequest = {
      scene,
      position,
      quaternion,
      ...rig.intrinsics.value,
      ...rig.viewport.value,
      ...setup,
      representations: rungs.map((rung) => ({ rung })) as SessionRequest["representations"] & object,
      stamp,
    };
    return openSession(base, request, this.#closing.signal);
  }

  /** Plays a session until it ends; tells why. */
  async #play(session: SessionInfo): Promise<string> {
    const { video, base, now, onReceived } = this.#options;
    const { playStream } = await import("./stream");
    this.#closing.signal.throwIfAborted();
    return new Promise((resolve) => {
      this.#closing.signal.addEventListener("abort", () => resolve(""), { once: true });
      const frames = new FramePoses<Shown>((pose, shown) => this.#present(session, pose, shown));
      this.#sent = -1;
      this.#meter.reset();
      this.#poses = openPoses(
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
      const presented: VideoFrameRequestCallback = (_, { mediaTime, expectedDisplayTime, width, height }) => {
        if (this.#stream !== stream) return;
        video.requestVideoFrameCallback(presented);
        this.phase.value = { kind: "playing" };
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
    this.#poses = this.#stream = this.#session = undefined;
  }
}
