/**
 * One viewer for minutes or hours: the page's own pipeline, limit, throughput and meters, and a controller, on a
 * simulated link, server and clock. Deterministic: the same options give the same figures.
 */

import { type ControllerFactory, type Observation, responseTime, type Way } from "#client/abr/controller";
import { seeded } from "#client/abr/random";
import { type Seen, seenLate, seenOfRung, together } from "#client/abr/seen-error";
import { ThroughputEstimator } from "#client/abr/throughput";
import type { DecodedImage, FrameReply } from "#client/transport/transport";
import type { Rung } from "#client/wire/render";
import { FramePipeline } from "#viewer/stateless/pipeline";
import { Meter } from "#viewer/view/meter";
import type { Endpoints } from "./endpoints";
import { EventLoop } from "./events";
import type { Head } from "./head";
import { type Figures, Tally } from "./tally";
import type { NetworkTrace } from "./trace";
import { SimulatedTransport } from "./transport";

export interface SimulationOptions {
  readonly controller: ControllerFactory;
  readonly trace: NetworkTrace;
  readonly ladder: readonly Rung[];
  /** Milliseconds to play; the trace starts again at its end. */
  readonly duration: number;
  /** Round trip in milliseconds; null for the trace's own delay. */
  readonly roundTrip: number | null;
  /** Creates new ones for each visit. */
  readonly endpoints: Endpoints;
  /** How the page shows a frame older than the view; `predicted` by default. */
  readonly way?: Way;
  /** The head movement that turns the camera; the endpoints' by default. */
  readonly head?: Head;
  readonly seed: number;
}

export async function simulate(options: SimulationOptions): Promise<Figures> {
  const { ladder, duration, endpoints, way = "predicted", head, seed } = options;
  const events = new EventLoop();
  const { now } = events;
  const random = seeded(seed);
  const transport = new SimulatedTransport(events, { ...options, random: seeded(seed + 1) });
  const controller = options.controller({ ladder, random });
  const throughput = new ThroughputEstimator();
  const tally = new Tally(ladder);
  const pictures = ladder.map(seenOfRung);
  const meter = new Meter("stateless", (frame) => tally.presented(frame));
  let turning = 0;
  const pipeline = simulatedPipeline({ events, transport, endpoints, throughput }, (frame) => {
    const { bytes } = frame.arrival;
    meter.received(bytes, now());
    tally.replied(responseTime(frame), bytes);
    controller.observe({ ...frame, turning, way });
  });
  let pose = 0;
  /** Time of each pose, and how far the camera had turned by then, in degrees. */
  const poses = [ORIGIN];
  let onScreen: { readonly pose: number; readonly picture: Seen } | undefined;
  /** The newest pose that a frame has shown. */
  let shownPose = 0;
  let presenting: ReturnType<FramePipeline["take"]>;
  const tick = () => {
    events.at(endpoints.nextAnimationFrame(now()), tick);
    events.settle();
    if (presenting) {
      const { header, pose: shown } = presenting;
      const { profile, width, height } = header;
      meter.presented({ at: now(), pose: shown, rung: profile ?? null, width: width ?? 0, height: height ?? 0 });
      shownPose = Math.max(shownPose, shown);
      const picture = pictures[profile ?? 0];
      if (picture) onScreen = { pose: shown, picture };
    }
    turning = head?.speed(now()) ?? endpoints.turning(now());
    const before = poses[pose] ?? ORIGIN;
    const view = { at: now(), turned: before.turned + (turning * (now() - before.at)) / 1000 };
    pose++;
    poses.push(view);
    const rendered = onScreen && poses[onScreen.pose];
    if (onScreen && rendered) {
      const turned = head?.turned(rendered.at, view.at) ?? view.turned - rendered.turned;
      tally.seen(together(onScreen.picture, seenLate(way, turned)), view.at - rendered.at);
    }
    meter.moved(pose, now());
    pipeline.want({ ...VIEW, azimuth: pose, profile: controller.decide(now()) }, pose);
    presenting = pipeline.take();
  };
  events.at(0, tick);
  await events.run(duration);
  pipeline.dispose();
  tally.unanswered(poses.slice(1 + shownPose).map(({ at }) => duration - at));
  return tally.figures(duration, meter.figures(duration).stalls);
}

interface Simulated {
  readonly events: EventLoop;
  readonly transport: SimulatedTransport;
  readonly endpoints: Endpoints;
  readonly throughput: ThroughputEstimator;
}

/** The page's own pipeline; `came` is called with each frame as a controller observes it. */
export function simulatedPipeline(
  { events, transport, endpoints, throughput }: Simulated,
  came: (frame: Omit<Observation, "turning" | "way">) => void,
): FramePipeline {
  const { now } = events;
  const decode = ({ image }: FrameReply): Promise<DecodedImage> =>
    new Promise((resolve) =>
      events.at(now() + endpoints.decode(transport.rungOf(image)), () => {
        events.settle();
        resolve({ bitmap: BITMAP, depth: null });
      }),
    );
  const pipeline: FramePipeline = new FramePipeline(transport, decode, now, {
    sent: () => undefined,
    replied: ({ header, arrival }) => {
      throughput.observe(arrival);
      came({
        profile: header.profile ?? null,
        arrival,
        server: header.timing ?? null,
        throughput: throughput.bitsPerSecond,
        inFlight: pipeline.inFlight - 1,
        at: now(),
      });
    },
    refused: () => undefined,
    unrefined: () => undefined,
    format: () => "jpeg",
    transmission: (bytes) => (throughput.bitsPerSecond === null ? 0 : (bytes * 8000) / throughput.bitsPerSecond),
  });
  return pipeline;
}

const ORIGIN = { at: 0, turned: 0 };
const VIEW = { scene: "simulated", fx: 1, fy: 1, cx: 0, cy: 0, width: 1280, height: 720 };
const BITMAP = { close: () => undefined } as ImageBitmap;
