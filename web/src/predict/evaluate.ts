/** How far off predictors are, over a recorded movement or a made-up person who steers: what they say against what comes. */

import { poseAt, type TimedPose } from "../movement/playback";
import { viewDistance } from "../view/camera";
import { type Rig, samePose } from "../view/rig";
import { angleBetween, subtract } from "../view/vector";
import { Guarded } from "./guarded";
import { createPredictor, type PredictorName } from "./registry";

/** A rig that moves as it is sampled, and the times of its samples. */
export interface Course {
  readonly rig: Rig;
  readonly times: readonly number[];
}

/** Of all predictions of one horizon. */
export interface Errors {
  readonly degrees: readonly number[];
  /** In the movement's unit. */
  readonly distance: readonly number[];
}

/** What is said in the first moments is not counted: there is nothing to learn from yet (ms). */
const BEGINNING = 500;
/** Between samples that are farther apart the truth is made up (ms). */
const GAP = 100;

/** A camera that rested so long, and goes on to rest, is not counted: nothing is to be foretold (ms). */
const LATELY = 200;

/** What the predictor says at each sample of where the camera is each horizon later: [horizon][sample]. */
export function predictions({ rig, times }: Course, name: PredictorName, horizons: readonly number[]) {
  const predictor = new Guarded(createPredictor(name, { rig }), () => viewDistance(rig.scene ?? { camera: null }));
  const said: TimedPose[][] = horizons.map(() => []);
  const seen: TimedPose[] = [];
  for (const at of times) {
    rig.sample(at);
    const { position, quaternion } = rig.pose;
    seen.push({ position, quaternion, t_ms: at });
    predictor.observe(rig.pose, at);
    for (const [i, horizon] of horizons.entries()) said[i]?.push({ ...predictor.predict(horizon), t_ms: at + horizon });
  }
  return { said, seen };
}

/** For each horizon, in milliseconds. */
export function evaluate(course: Course, name: PredictorName, horizons: readonly number[]): Errors[] {
  const { said, seen } = predictions(course, name, horizons);
  const begin = (seen[0]?.t_ms ?? 0) + BEGINNING;
  const end = seen.at(-1)?.t_ms ?? 0;
  const gaps = seen.flatMap(({ t_ms }, i) => {
    const before = seen[i - 1]?.t_ms ?? t_ms;
    return t_ms - before > GAP ? [{ from: before, to: t_ms }] : [];
  });
  return horizons.map((horizon, i) => {
    const counted = (said[i] ?? []).filter(({ t_ms: at }) => {
      const now = at - horizon;
      if (now < begin || at > end || gaps.some(({ from, to }) => from < at && to > now - BEGINNING)) return false;
      return !samePose(poseAt(seen, now - LATELY), poseAt(seen, now)) || !samePose(poseAt(seen, now), poseAt(seen, at));
    });
    const truths = counted.map(({ t_ms }) => poseAt(seen, t_ms));
    return {
      degrees: counted.map(({ quaternion }, k) => angleBetween(quaternion, (truths[k] as TimedPose).quaternion)),
      distance: counted.map(({ position }, k) => Math.hypot(...subtract(position, (truths[k] as TimedPose).position))),
    };
  });
}
