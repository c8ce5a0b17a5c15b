/**
 * All predictors, by the name that settings and experiments know them by.
 *
 * To add your own: write a class with `observe()` and `predict()` in a file of its own beside this one, and add a line here. The
 * viewer, `npm run predict-report` and experiments then offer it.
 */
import { Auto } from "./auto";
import { Input } from "./input";
import { Linear } from "./linear";
import { Off } from "./off";
import type { Predictor, PredictorContext, PredictorFactory } from "./predictor";
import { Velocity } from "./velocity";

interface Entry {
  /** As a person reads it. */
  readonly title: string;
  readonly create: PredictorFactory;
}

export const PREDICTORS = {
  off: { title: "Off", create: () => new Off() },
  velocity: { title: "Constant velocity", create: () => new Velocity() },
  linear: { title: "Linear", create: () => new Linear() },
  input: { title: "Keys and pointer", create: (context) => new Input(context) },
  auto: { title: "Automatic", create: (context) => new Auto(context) },
} as const satisfies Record<string, Entry>;

export type PredictorName = keyof typeof PREDICTORS;

export const PREDICTOR_NAMES = Object.keys(PREDICTORS) as readonly PredictorName[];

export function createPredictor(name: PredictorName, context: PredictorContext): Predictor {
  const { create }: Entry = PREDICTORS[name];
  return create(context);
}
