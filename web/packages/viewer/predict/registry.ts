/**
 * All predictors, by their names in settings and experiments.
 *
 * To add one, write a function in a new file in this folder, add a line here, and add its name to `PredictorName` in
 * `services/experiments/tigas_experiments/wire/run.py`. The viewer and experiments then offer it.
 */
import { linear } from "./linear";
import type { Predict } from "./pose-history";
import { velocity } from "./velocity";

interface Entry {
  /** Name on the page. */
  readonly title: string;
  readonly predict: Predict;
}

export const PREDICTORS = {
  off: { title: "Off", predict: (history) => history.last },
  velocity: { title: "Constant velocity", predict: velocity },
  linear: { title: "Linear", predict: linear },
} as const satisfies Record<string, Entry>;

export type PredictorName = keyof typeof PREDICTORS;

export const PREDICTOR_NAMES = Object.keys(PREDICTORS) as readonly PredictorName[];
