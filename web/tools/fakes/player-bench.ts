/**
 * For tests: a stateless player over fake transport, display and warp, with a clock and settings controlled by the
 * test.
 */
import { vi } from "vitest";
import type { Observation } from "#client/abr/controller";
import type { VideoStep } from "#client/abr/video-ladder";
import { Display } from "#viewer/enhance/display";
import { Enhancement } from "#viewer/enhance/enhancement";
import { Overlay } from "#viewer/enhance/overlay";
import type { PredictorName } from "#viewer/predict/registry";
import { Reprojector } from "#viewer/reproject/reprojector";
import type { DecodedFrame } from "#viewer/stateless/pipeline";
import { type Reply, type ShownFrame, StatelessPlayer } from "#viewer/stateless/stateless-player";
import type { Pictured } from "#viewer/stateless/turning";
import { VideoFrames } from "#viewer/video/video-frames";
import type { PresentedFrame } from "#viewer/view/presented";
import { FakeDecoder } from "./decoder";
import { PLACE } from "./gpu";
import { STILL, steeredRig } from "./rig";
import { FakeTransport, settle } from "./transport";
import { FakeWarp } from "./warp";

const SIZE = { width: 1280, height: 720 };

export class PlayerBench {
  now = 1000;
  /** Animation frames of the display per second. */
  rate = 60;
  axes = STILL;
  profile = 0;
  refine = false;
  bitrateKbps: number | undefined;
  observed: (observation: Observation) => void = () => undefined;
  prediction: PredictorName = "off";
  overscan: number | "auto" = "auto";
  depth = true;
  webp = false;
  surround = false;
  size = SIZE;
  videoSteps: readonly VideoStep[] | null = null;
  readonly videoDecoder = new FakeDecoder();
  readonly video: VideoFrames;
  /** Frames drawn to the canvas without a warp. */
  readonly drawn: unknown[] = [];
  readonly replies: Reply[] = [];
  readonly shown: ShownFrame[] = [];
  presented: PresentedFrame[] = [];
  transport!: FakeTransport;
  readonly rig = steeredRig(() => this.axes);
  readonly reprojector: Reprojector<Pictured>;
  /** The reprojector's warp, once it is on. */
  warp!: FakeWarp;
  readonly player: StatelessPlayer;

  /** `undecodable` is the reason why this browser cannot decode video. */
  constructor(display?: Display<DecodedFrame>, undecodable: string | null = null) {
    vi.spyOn(performance, "now").mockImplementation(() => this.now);
    const { videoDecoder } = this;
    this.video = new VideoFrames(() => videoDecoder, Promise.resolve(undecodable));
    this.reprojector = new Reprojector({
      below: { after: () => undefined, ownerDocument: { createElement: fakeCanvas } } as unknown as HTMLElement,
      size: () => this.size,
      create: (canvas, options) => {
        this.warp = new FakeWarp(canvas, options);
        return this.warp;
      },
    });
    this.player = new StatelessPlayer({
      display: display ?? this.#display(),
      reprojector: this.reprojector,
      webp: () => this.webp,
      settings: { peek: () => this },
      ladder: { peek: () => PLACE.ladder },
      rig: this.rig,
      video: this.video,
      videoSteps: { peek: () => this.videoSteps },
      controller: { peek: () => ({ decide: () => this.profile, observe: (heard) => this.observed(heard) }) },
      pixelRatio: { peek: () => 2 },
      onPresented: (frame) => this.presented.push(frame),
      onShown: (frame) => this.shown.push(frame),
      onSent: () => undefined,
      onReplied: (reply) => this.replies.push(reply),
      onReceived: () => undefined,
    });
    this.resize(SIZE.width, SIZE.height);
    this.connect();
  }

  /** Sets the size of the stage in screen pixels. */
  resize(width: number, height: number): void {
    this.size = { width, height };
    this.rig.resize(width, height);
  }

  /** Connects to a server, with unknown figures. */
  connect(): void {
    this.transport = new FakeTransport(() => this.now, { kind: "webtransport-streams" });
    this.player.attach({ transport: this.transport, fallback: null, host: null });
  }

  /** Runs animation frames; the server answers all requests when `answer` allows it. */
  async frames(count: number, { answer = true } = {}): Promise<void> {
    for (let i = 0; i < count; i++) {
      this.now += 1000 / this.rate;
      this.player.presented(this.now);
      this.player.tick(this.now, this.rig.sample(this.now));
      if (answer) for (const { reply } of this.transport.requests) reply();
      await settle();
    }
  }

  last() {
    return this.transport.requests.at(-1)?.request;
  }

  #display(): Display<DecodedFrame> {
    const context = { transferFromImageBitmap: (bitmap: unknown) => this.drawn.push(bitmap) };
    const canvas = { style: {}, getContext: () => context } as unknown as HTMLCanvasElement;
    const overlay = new Overlay(canvas);
    const enhancement = new Enhancement({ overlay });
    return new Display({ canvas, overlay, enhancement, size: () => this.size });
  }
}

const fakeCanvas = () => ({ classList: { add: () => undefined }, remove: () => undefined, width: 0, height: 0 });
