/** What predictors are measured on: movements from files, and a made-up person who steers by keys and pointer. */
import { seeded } from "../abr/random";
import { poseAt, type TimedPose } from "../movement/playback";
import { type Axes, type InputSample, NO_INPUT, NO_NUDGE } from "../view/motion";
import { Rig } from "../view/rig";
import type { SceneInfo } from "../wire/render";
import type { Course } from "./evaluate";

/** What is looked at is 4 m away, as a movement in metres has it. */
const SCENE = { up: [0, -1, 0], camera: { position: [0, 0, -4], look_at: [0, 0, 0] } } as SceneInfo;
const TURN_SPEED = 60;
const RATE = 60;

/** A movement as it was recorded, pose by pose, or at so many samples a second. */
export function recorded(points: readonly TimedPose[], rate: number | null = null): Course {
  const rig = rigOf(() => NO_INPUT);
  rig.drive((now) => poseAt(points, now));
  const last = points.at(-1)?.t_ms ?? 0;
  const times = rate === null ? points.map(({ t_ms }) => t_ms) : evenly(last, rate);
  return { rig, times };
}

/**
 * Someone at a keyboard and a mouse, at 60 Hz: holds one key or two for half a second in the median (log-normal, sigma 0.8), and
 * between those drags the picture in minimum-jerk movements (Flash and Hogan, J. Neuroscience 5, 1985). Nobody recorded real ones.
 */
export function steered(seconds: number, seed: number): Course {
  const random = seeded(seed);
  const normal = () => Math.sqrt(-2 * Math.log(1 - random())) * Math.cos(2 * Math.PI * random());
  const times = evenly(seconds * 1000, RATE);
  const inputs: InputSample[] = [];
  while (inputs.length < times.length) {
    if (random() < 0.6)
      inputs.push(...repeated({ axes: keys(random), nudge: NO_NUDGE }, 500 * Math.exp(0.8 * normal())));
    else inputs.push(...drag(20 * Math.exp(0.7 * normal()), random));
    inputs.push(...repeated(NO_INPUT, 600 * random()));
  }
  let next = 0;
  return { rig: rigOf(() => inputs[next++] ?? NO_INPUT), times };
}

function rigOf(sampleInput: () => InputSample): Rig {
  const rig = new Rig({ sampleInput, turnSpeed: () => TURN_SPEED });
  rig.enter(SCENE);
  return rig;
}

function evenly(until: number, rate: number): number[] {
  return Array.from({ length: Math.floor((until * rate) / 1000) + 1 }, (_, i) => (i * 1000) / rate);
}

function repeated(input: InputSample, milliseconds: number): InputSample[] {
  return Array.from({ length: Math.ceil((milliseconds * RATE) / 1000) }, () => input);
}

function keys(random: () => number): Axes {
  const axes = { ...NO_INPUT.axes };
  const names = ["turnRight", "forward", "right", "turnUp"] as const;
  for (let held = random() < 0.5 ? 1 : 2; held > 0; held--) {
    axes[names[Math.floor(random() * names.length)] ?? "forward"] = random() < 0.5 ? -1 : 1;
  }
  return axes;
}

/** A larger one takes longer. */
function drag(degrees: number, random: () => number): InputSample[] {
  const frames = Math.round(RATE * (0.25 + (degrees / 120) * (0.6 + random())));
  const direction = 2 * Math.PI * random();
  const way = (share: number) => degrees * share ** 3 * (10 - 15 * share + 6 * share ** 2);
  return Array.from({ length: frames }, (_, i) => {
    const far = way((i + 1) / frames) - way(i / frames);
    const nudge = { ...NO_NUDGE, turnRight: far * Math.cos(direction), turnUp: (far * Math.sin(direction)) / 3 };
    return { axes: NO_INPUT.axes, nudge };
  });
}
