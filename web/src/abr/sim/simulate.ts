/**
 * One viewer for some minutes or hours: the page's own pipeline, limit, throughput and meters, and a controller, in front of a
 * simulated link, server and clock. Everything follows from the options; the same options give the same figures.
 */

import { Meter } from "../../player/meter";
import { FramePipeline } from "../../player/pipeline";
import type { Rung } from "../../wire";
import { type ControllerFactory, responseTime } from "../controller";
import { ThroughputEstimator } from "../throughput";
import { EventLoop } from "./events";
import { Motion } from "./motion";
import { seeded } from "./random";
import { type Figures, Tally } from "./tally";
import type { NetworkTrace } from "./trace";
import { SimulatedTransport } from "./transport";

export interface SimulationOptions {
  readonly controller: ControllerFactory;
  readonly trace: NetworkTrace;
  readonly ladder: readonly Rung[];
  /** Milliseconds to play; the trace starts again at its end. */
  readonly duration: number;
  /** The way there and back in milliseconds; null: the trace's own delay. */
  readonly roundTrip: number | null;
  /** The server's milliseconds to render a frame, and to encode one of the best rung. */
  readonly render: number;
  readonly encode: number;
  readonly seed: number;
}

/** The paper's figures for an RTX 2060 Super: rasterising 11 ms, encoding under 1 ms. */
export const PAPER_SERVER = { render: 11, encode: 1 } as const;

/** Decoding takes this long in the page, in milliseconds. */
const DECODE = 4;
const ANIMATION_FRAME = 1000 / 60;

export async function simulate(options: SimulationOptions): Promise<Figures> {
  const { ladder, duration, seed } = options;
  const events = new EventLoop();
  const { now } = events;
  const random = seeded(seed);
  const transport = new SimulatedTransport(events, { ...options, random: seeded(seed + 1) });
  const controller = options.controller({ ladder, random });
  const throughput = new ThroughputEstimator();
  const motion = new Motion(seeded(seed + 2));
  const tally = new Tally();
  const meter = new Meter("stateless", (frame) => tally.presented(frame));
  let turning = 0;
  const pipeline: FramePipeline = new FramePipeline(transport, () => decode(events), now, {
    replied: ({ header, arrival }) => {
      throughput.observe(arrival);
      meter.received(arrival.bytes, now());
      const observation = {
        profile: header.profile ?? null,
        arrival,
        server: header.timing ?? null,
        throughput: throughput.bitsPerSecond,
        inFlight: pipeline.inFlight - 1,
        turning,
        at: now(),
      };
      tally.replied(responseTime(observation), arrival.bytes);
      controller.observe(observation);
    },
    refused: () => undefined,
    transmission: (bytes) => (throughput.bitsPerSecond === null ? 0 : (bytes * 8000) / throughput.bitsPerSecond),
  });
  let pose = 0;
  let presenting: ReturnType<FramePipeline["take"]>;
  const tick = () => {
    events.at(now() + ANIMATION_FRAME, tick);
    events.settle();
    if (presenting) {
      const { header, pose: shown } = presenting;
      const { profile, width, height } = header;
      meter.presented({ at: now(), pose: shown, rung: profile ?? null, width: width ?? 0, height: height ?? 0 });
    }
    turning = motion.speed(now());
    pose++;
    meter.moved(pose, now());
    pipeline.want({ ...VIEW, azimuth: pose, profile: controller.decide() }, pose);
    presenting = pipeline.take();
  };
  events.at(0, tick);
  await events.run(duration);
  pipeline.dispose();
  return tally.figures(duration, meter.figures(duration).stalls);
}

const VIEW = { scene: "simulated", fx: 1, fy: 1, cx: 0, cy: 0, width: 1280, height: 720 };
const BITMAP = { close: () => undefined } as ImageBitmap;

function decode(events: EventLoop): Promise<ImageBitmap> {
  return new Promise((resolve) =>
    events.at(events.now() + DECODE, () => {
      events.settle();
      resolve(BITMAP);
    }),
  );
}
