/**
 * A viewer with recorded head movement, reprojection and prediction, over a simulated link and server: measures the
 * share of the picture that was never rendered. It uses the page's own pipeline, foresight, overscan and surround,
 * without drawing.
 */
import { type ControllerFactory, responseTime } from "#client/abr/controller";
import { seeded } from "#client/abr/random";
import { ThroughputEstimator } from "#client/abr/throughput";
import type { Rung, SceneInfo } from "#client/wire/render";
import { poseAt, type TimedPose } from "#viewer/movement/movement";
import { Foresight } from "#viewer/predict/foresight";
import { AutoOverscan } from "#viewer/reproject/overscan";
import type { View } from "#viewer/reproject/view";
import type { DecodedFrame } from "#viewer/stateless/pipeline";
import { Rest } from "#viewer/stateless/refinement";
import { SurroundFeed } from "#viewer/stateless/surround-feed";
import { widened } from "#viewer/stream/camera-feed";
import { viewDistance } from "#viewer/view/camera";
import { NO_INPUT } from "#viewer/view/motion";
import { Rig } from "#viewer/view/rig";
import type { Endpoints } from "./endpoints";
import { EventLoop } from "./events";
import { Seen } from "./seen";
import { simulatedPipeline } from "./simulate";
import type { NetworkTrace } from "./trace";
import { SimulatedTransport } from "./transport";

export interface HeadOptions {
  readonly controller: ControllerFactory;
  readonly trace: NetworkTrace;
  readonly ladder: readonly Rung[];
  /** Round trip in milliseconds. */
  readonly roundTrip: number;
  readonly endpoints: Endpoints;
  /** The movement in metres, from the start camera; times are in milliseconds since the start of playback. */
  readonly points: readonly TimedPose[];
  /** Times for which the viewer stands at the first pose, and then moves, in milliseconds. */
  readonly warmUp: number;
  readonly duration: number;
  readonly surround: boolean;
  readonly seed: number;
}

/** Figures for the time in which the viewer moves. */
export interface Visit {
  /** Mean share of the picture that was never rendered. */
  readonly never: number;
  /** Mean time from a frame's request to its last byte, in milliseconds. */
  readonly response: number;
  readonly framesPerSecond: number;
  /** Bit rate of the surround, in megabits per second. */
  readonly aside: number;
}

/** The focus is 4 m away, for movements in metres. */
const SCENE = { id: "simulated", up: [0, -1, 0], camera: { position: [0, 0, -4], look_at: [0, 0, 0] } } as SceneInfo;
const VIEWPORT = { width: 1280, height: 720 };
/** Sampling interval of the seen picture, in milliseconds. */
const LOOK_EVERY = 50;

export async function visit(options: HeadOptions): Promise<Visit> {
  const { ladder, endpoints, points, warmUp, duration, seed } = options;
  const events = new EventLoop();
  const { now } = events;
  const transport = new SimulatedTransport(events, { ...options, random: seeded(seed + 1) });
  const controller = options.controller({ ladder, random: seeded(seed) });
  const throughput = new ThroughputEstimator();
  const rig = new Rig({ sampleInput: () => NO_INPUT, turnSpeed: () => 60 });
  rig.resize(VIEWPORT.width, VIEWPORT.height);
  rig.enter(SCENE);
  rig.drive((at) => poseAt(points, Math.max(0, at - warmUp)));
  const distance = viewDistance(SCENE);
  const [foresight, overscan, seen] = [
    new Foresight(rig, () => "linear"),
    new AutoOverscan(distance),
    new Seen(distance),
  ];
  const rest = new Rest();
  const sides = new Map<number, View>();
  const counts = { looks: 0, never: 0, frames: 0 };
  const replies = { count: 0, response: 0, aside: 0 };
  const moving = () => now() >= warmUp;
  let shown: { readonly frame: DecodedFrame; readonly asked: View; readonly at: number } | undefined;
  let presenting: typeof shown;
  const feed = new SurroundFeed({
    reprojector: {
      working: true,
      get content() {
        return shown && ({} as never);
      },
      surround: sides,
      takeSide: (_, side, view) => sides.set(side, view),
    },
    rig,
    settings: { peek: () => options },
    ladder: { peek: () => ladder },
    onReceived: (bytes) => {
      if (moving()) replies.aside += bytes;
    },
  });
  const pipeline = simulatedPipeline({ events, transport, endpoints, throughput }, (frame) => {
    if (moving()) {
      replies.count++;
      replies.response += responseTime(frame);
    }
    controller.observe({ ...frame, turning: rig.turning, way: "predicted" });
  });
  const lens = { ...rig.intrinsics.value, ...VIEWPORT };
  let lookedAt = warmUp;
  const tick = () => {
    events.at(endpoints.nextAnimationFrame(now()), tick);
    events.settle();
    const at = now();
    if (presenting) foresight.shown(presenting.frame.askedAt, at);
    presenting = undefined;
    rig.sample(at);
    const { position, quaternion } = foresight.pose(at);
    const share = overscan.at(at);
    const view = { scene: SCENE.id, position, quaternion, ...lens, profile: controller.decide(at) };
    pipeline.want(rest.view({ ...view, ...(share > 0 && { overscan: share }) }, controller), rig.pose.seq);
    feed.tick(pipeline, view, throughput.bitsPerSecond, at);
    const frame = pipeline.take();
    if (frame) {
      const { asked } = frame;
      const inner = { ...asked, position: asked.position ?? [0, 0, 0], quaternion: asked.quaternion ?? [0, 0, 0, 1] };
      shown = presenting = { frame, asked: inner, at };
      seen.take(widened(inner, asked.overscan ?? 0));
      if (moving()) counts.frames++;
    }
    const onScreen = { ...foresight.onScreen(at), ...lens };
    if (shown) overscan.observe(shown.asked, onScreen, at);
    if (at < lookedAt + LOOK_EVERY) return;
    lookedAt += LOOK_EVERY;
    counts.looks++;
    counts.never += seen.never(onScreen, sides.values());
  };
  events.at(0, tick);
  await events.run(warmUp + duration);
  pipeline.dispose();
  return {
    never: counts.never / counts.looks,
    response: replies.response / replies.count,
    framesPerSecond: (counts.frames * 1000) / duration,
    aside: (replies.aside * 8) / 1000 / duration,
  };
}
