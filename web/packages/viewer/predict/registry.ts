/**
 * All predictors, by their names in settings and experiments.
 *
 * To add a predictor, write a class with `observe()` and `predict()` in a new file in this folder, add a line here, and
 * add its name to `PredictorName` in `services/experiments/tigas_experiments/wire/run.py`. The viewer and experiments then offer
 * it.
 */
import { Linear } from "./linear";
import { Off, type Predictor } from "./predictor";
import { Velocity } from "./velocity";

interface Entry {
  /** As a person reads it. */
  readonly title: string;
  readonly create: () => Predictor;
}

export const PREDICTORS = {
  off: { title: "Off", create: () => new Off() },
  velocity: { title: "Constant velocity", create: () => new Velocity() },
  linear: { title: "Linear", create: () => new Linear() },
} as const satisfies Record<string, Entry>;

export type PredictorName = keyof typeof PREDICTORS;

export const PREDICTOR_NAMES = Object.keys(PREDICTORS) as readonly PredictorName[];

export function createPredictor(name: PredictorName): Predictor {
  return PREDICTORS[name].create();
}
