/** Requests the view of the rig's pose and shows the answer: an independent picture, or the next frame of a video. */

import { signal } from "@preact/signals";
import type { Controller, Observation, Way } from "#client/abr/controller";
import { RateCap } from "#client/abr/rate-cap";
import type { VideoStep } from "#client/abr/video-ladder";
import type { Connected } from "#client/transport/connect";
import type { DecodedImage, FrameReply } from "#client/transport/transport";
import type { Rung, SceneInfo } from "#client/wire/render";
import type { Display, Enhanced } from "../enhance/display";
import { Foresight } from "../predict/foresight";
import type { Reprojector } from "../reproject/reprojector";
import type { SideSettings } from "../state/settings";
import type { VideoFrames } from "../video/video-frames";
import { Meter, STATS_EVERY } from "../view/meter";
import type { PresentedFrame } from "../view/presented";
import type { Rig } from "../view/rig";
import { TimeWindow } from "../view/window";
import { FormatChoice } from "./picture-format";
import { type DecodedFrame, FramePipeline, type SentRequest, type ViewRequest } from "./pipeline";
import { type PosedRequest, Refinement, Rest } from "./refinement";
import { NO_STATS, type Stats, StatsRecorder, type VideoStats } from "./stats";
import { SurroundFeed } from "./surround-feed";
import { type Pictured, pictured, Turning } from "./turning";

/** A received frame: the controllers' observation of it, and its request. */
export interface Reply extends Observation {
  readonly pose: number;
  /** The rung; null for a refinement, which the controller does not observe. */
  readonly asked: number | null;
}

/** The frame on screen, before any warp. */
export interface ShownFrame extends Pick<DecodedFrame, "asked" | "header" | "image"> {
  /** Time when it appeared on the screen, on the page's clock. */
  readonly at: number;
  /** Its enhancement; null if there was none. */
  readonly enhanced: Enhanced | null;
}

/** A value that changes, such as a signal's. */
interface Changing<T> {
  peek(): T;
}

type PlayerSettings = Pick<SideSettings, "overscan" | "depth" | "surround" | "refine" | "prediction"> & {
  readonly bitrateKbps?: number | undefined;
};

/** The parts of a visit that every source needs. */
export interface Visit {
  readonly rig: Rig;
  readonly onPresented: (frame: PresentedFrame) => void;
  /** Called with a frame that was requested individually, before any warp; it is on the canvas during this call. */
  readonly onShown: (frame: ShownFrame) => void;
  readonly onSent: (request: SentRequest) => void;
  /** Called when a frame has arrived and the controller has observed it. */
  readonly onReplied: (reply: Reply) => void;
  /** Called when bytes of pictures or of the scene are received. */
  readonly onReceived: (bytes: number) => void;
}

export interface StatelessPlayerOptions extends Visit {
  readonly settings: Changing<PlayerSettings>;
  /** The ladder that request profiles index; empty until it is known. */
  readonly ladder: Changing<readonly Rung[]>;
  /** Screen pixels per viewport pixel. */
  readonly pixelRatio: Changing<number>;
  readonly display: Display<DecodedFrame>;
  /** Warps the displayed frame to the pose of each animation frame, if enabled. */
  readonly reprojector: Reprojector<Pictured>;
  /** Whether pictures may be WebP. */
  readonly webp: () => boolean;
  /** Null if each answer is an independent picture. */
  readonly video: VideoFrames | null;
  /** The ladder of a video that the controller's choice indexes; null if each answer is an independent picture. */
  readonly videoSteps: Changing<readonly VideoStep[] | null>;
  readonly controller: Changing<Controller>;
}

/** Window of the time that enhancement takes, in milliseconds. */
const ENHANCEMENT_SPAN = 5000;
/** Limits of the wait for a frame that others refer to, which is about as long as an answer takes, in milliseconds. */
const LEAST_PATIENCE = 50;
const USUAL_PATIENCE = 200;
const MOST_PATIENCE = 500;

export class StatelessPlayer {
  readonly stats = signal<Stats>(NO_STATS);
  /** Why the server currently refuses frames, or null. */
  readonly problem = signal<string | null>(null);
  readonly #options: StatelessPlayerOptions;
  readonly #enhanceTimes = new TimeWindow(ENHANCEMENT_SPAN);
  readonly #foresight: Foresight;
  readonly #turning: Turning;
  readonly #surround: SurroundFeed;
  #meter: Meter;
  #recorder = new StatsRecorder();
  #pipeline: FramePipeline | undefined;
  #connected: Connected | undefined;
  #refinement = new Refinement();
  #format = new FormatChoice();
  readonly #rest = new Rest<PosedRequest>();
  readonly #cap = new RateCap();
  #publishedAt = 0;

  constructor(options: StatelessPlayerOptions) {
    this.#options = options;
    this.#foresight = new Foresight(options.rig, () => options.settings.peek().prediction);
    this.#turning = new Turning(options);
    this.#surround = new SurroundFeed({
      ...options,
      onReceived: (bytes) => {
        this.#cap.besides(bytes);
        this.#received(bytes);
      },
    });
    this.#meter = new Meter("stateless", options.onPresented);
  }

  /** Switches to this transport; null while there is no connection. */
  attach(connected: Connected | null): void {
    this.#pipeline?.dispose();
    this.#meter = new Meter("stateless", this.#options.onPresented);
    this.#recorder = new StatsRecorder();
    this.#refinement = new Refinement();
    this.#format = new FormatChoice();
    this.#foresight.reset();
    this.#surround.reset();
    this.#connected = connected ?? undefined;
    const { display, video } = this.#options;
    const now = () => performance.now();
    display.forget();
    video?.reset();
    this.#pipeline =
      connected === null
        ? undefined
        : new FramePipeline(video?.over(connected.transport) ?? connected.transport, this.#decode, now, {
            sent: (request) => {
              this.#cap.asked();
              this.#options.onSent(request);
            },
            replied: (reply, view, pose) => {
              this.#recorder.replied(reply, now());
              this.#refinement.observe(reply);
              this.#format.observe(reply, now());
              this.#cap.came(reply.arrival.bytes);
              this.#received(reply.arrival.bytes);
              this.problem.value = null;
              const profile = reply.header.profile ?? null;
              const observation = {
                profile,
                arrival: reply.arrival,
                server: reply.header.timing ?? null,
                throughput: this.#recorder.throughput.bitsPerSecond,
                inFlight: (this.#pipeline?.inFlight ?? 1) - 1,
                turning: this.#options.rig.turning,
                way: this.#way,
                at: now(),
              };
              const asked = view.profile ?? null;
              if (asked !== null) {
                this.#options.controller.peek().observe({ ...observation, profile: this.#chosen(view, profile) });
              }
              this.#options.onReplied({ ...observation, pose, asked });
            },
            refused: (problem) => {
              this.problem.value = problem.message;
            },
            unrefined: () => this.#refinement.failed(),
            format: () =>
              this.#options.webp() ? this.#format.next(this.#recorder.throughput.bitsPerSecond, now()) : "jpeg",
            transmission: (bytes) => {
              const rate = this.#recorder.throughput.bitsPerSecond;
              return rate === null ? 0 : (bytes * 8000) / rate;
            },
          });
  }

  dispose(): void {
    this.attach(null);
  }

  resumed(gap: number): void {
    this.#meter.resumed(gap);
    this.#foresight.reset();
    this.#pipeline?.pause();
    this.#options.display.forget();
    this.#options.reprojector.resumed();
  }

  picture(): Promise<ImageBitmap> {
    return this.#options.reprojector.picture() ?? this.#options.display.picture();
  }

  /**
   * Called at the start of each animation frame: the frame handed to the display is on the screen by now, or will be
   * once it is enhanced.
   */
  presented(now: number): void {
    const { display, reprojector, onShown } = this.#options;
    const turned = reprojector.presented();
    if (turned) {
      const { frame, pose, view, filled, warpMs, fresh } = turned;
      this.#meter.presented({ at: now, pose, view, filled, warpMs, ...frame }, fresh);
    }
    const shown = display.presented(now);
    if (shown === null) return;
    const { frame, enhanced } = shown;
    this.#foresight.shown(frame.askedAt, now);
    if (enhanced) this.#enhanceTimes.add(enhanced.ms, now);
    if (!this.#turning.working) this.#meter.presented({ at: now, pose: frame.pose, ...pictured(frame, enhanced) });
    const { asked, header, image } = frame;
    onShown({ at: now, asked, header, image, enhanced });
  }

  tick(now: number, moved: boolean): void {
    const { rig, display, video, settings } = this.#options;
    this.#meter.sampled(rig.pose.seq, now);
    if (this.#pipeline && rig.scene) {
      if (moved) this.#meter.moved(rig.pose.seq, now);
      const view = this.#view(rig.scene, now);
      video?.tick(Math.min(MOST_PATIENCE, Math.max(LEAST_PATIENCE, this.stats.peek().roundTrip ?? USUAL_PATIENCE)));
      if (this.#cap.allows(settings.peek().bitrateKbps ?? null, now)) {
        if ((video?.problem.peek() ?? null) === null) this.#pipeline.want(view, rig.pose.seq);
        this.#surround.tick(this.#pipeline, view, this.#recorder.throughput.bitsPerSecond, now);
      }
      // The newest frame waits where it can be overtaken, not in the graphics processor's queue.
      const frame = display.ready ? this.#pipeline.take() : undefined;
      if (frame) display.show(frame);
    }
    if (this.#turning.working) this.#turning.turn(this.#foresight.onScreen(now), now);
    this.#publish(now);
  }

  readonly #decode = (reply: FrameReply, signal: AbortSignal): Promise<DecodedImage> => {
    const { video } = this.#options;
    const picture = reply.header.video && video ? video.decode(reply, signal) : reply.picture;
    return picture ?? Promise.reject(new Error("the frame was not decoded"));
  };

  /**
   * The controller's choice for a received frame: a rung, or a step of the video's ladder; null if something else chose
   * it.
   */
  #chosen({ video }: ViewRequest, profile: number | null): number | null {
    const steps = this.#options.videoSteps.peek();
    if (steps === null) return video ? null : profile;
    const step = steps.findIndex((one) => one.video === video);
    return step < 0 ? null : step;
  }

  #received(bytes: number): void {
    this.#meter.received(bytes, performance.now());
    this.#options.onReceived(bytes);
  }

  #view(scene: SceneInfo, now: number): PosedRequest {
    const { rig, settings, pixelRatio, videoSteps } = this.#options;
    const controller = this.#options.controller.peek();
    const { position, quaternion } = this.#foresight.pose(now);
    const chosen = controller.decide(now);
    const step = videoSteps.peek()?.[chosen];
    const view: PosedRequest = {
      scene: scene.id,
      position,
      quaternion,
      ...rig.intrinsics.value,
      ...rig.viewport.value,
      ...(step ? { profile: step.rung, format: "h264", video: step.video } : { profile: chosen }),
      ...this.#turning.request(scene, now, step !== undefined),
      // A loaded scene is a new view, which is requested even if the camera rests.
      ...(scene.state === "loading" && { coarse: true }),
    };
    const rested = this.#rest.view(view, controller);
    if (!settings.peek().refine) return rested;
    const throughput = this.#recorder.throughput.bitsPerSecond;
    const settled = this.#pipeline?.settled === true && !this.#surround.hurries(throughput);
    return this.#refinement.next(view, { now, settled, throughput, pixelRatio: pixelRatio.peek() }) ?? rested;
  }

  /** How a frame older than the view is shown. */
  get #way(): Way {
    if (!this.#turning.working) return "stale";
    const { settings, videoSteps } = this.#options;
    const { depth, prediction } = settings.peek();
    if (prediction !== "off") return "predicted";
    return depth && videoSteps.peek() === null ? "depth" : "rotation";
  }

  /** Whether the newest view is on the screen, as sharp as it gets. */
  get #settled(): boolean {
    if (this.#pipeline === undefined) return true;
    const refining = this.#options.settings.peek().refine && this.#refinement.pending;
    return this.#pipeline.settled && this.#options.display.settled && !refining;
  }

  #videoStats(now: number): VideoStats | null {
    const { controller, video, videoSteps } = this.#options;
    const step = videoSteps.peek()?.[controller.peek().decide(now)];
    return step && video ? { bitrate: step.video.bitrate_kbps * 1000, keyFrames: video.keyFrames } : null;
  }

  #publish(now: number): void {
    const pipeline = this.#pipeline;
    const settled = this.#settled;
    if (now - this.#publishedAt < STATS_EVERY && settled === this.stats.peek().settled) return;
    this.#publishedAt = now;
    this.stats.value = {
      kind: "requests",
      ...this.#meter.figures(now),
      ...this.#recorder.snapshot(now),
      transport: this.#connected?.transport.kind ?? null,
      video: this.#videoStats(now),
      enhanceMs: this.#enhanceTimes.percentile(0.5, now),
      warpMs: this.#options.reprojector.warpMs(now),
      gpuMs: this.#options.reprojector.gpuMs,
      inFlight: pipeline?.inFlight ?? 0,
      settled,
      counts: pipeline?.counts ?? NO_STATS.counts,
    };
  }
}
