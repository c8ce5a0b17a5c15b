/**
 * Linear autoregression: the future displacement is a weighted sum of past ones, in even steps back, for each axis of
 * the camera's own frame. `python -m benchmarks.train_predictor` trained the weights on headset recordings
 * (docs/adaptation.md).
 */
import type { Vector3 } from "../view/vector";
import { changed, type PoseChange, type Predict } from "./pose-history";

/** Weights of each step, for each horizon: one axis. */
type Weights = readonly (readonly number[])[];

interface Coefficients {
  readonly step_ms: number;
  /** Number of steps that they look back. */
  readonly steps: number;
  readonly horizons_ms: readonly number[];
  readonly turned: readonly Weights[];
  readonly moved: readonly Weights[];
}

/** Null until they are loaded; until then a prediction is the current pose. */
let coefficients: Coefficients | null = null;
let loading: Promise<void> | undefined;

/** Loads the weights, with the first prediction that needs them. */
export function loadCoefficients(): Promise<void> {
  loading ??= import("./coefficients.json").then(({ default: trained }) => {
    coefficients = { ...trained, steps: trained.turned[0]?.[0]?.length ?? 0 };
  });
  return loading;
}

export const linear: Predict = (history, ahead) => {
  if (coefficients === null) {
    loadCoefficients().catch(() => undefined); // the page reports that it is outdated
    return history.last;
  }
  const { steps, step_ms, moved, turned, horizons_ms } = coefficients;
  const past = Array.from({ length: steps }, (_, i) => history.since(step_ms * (i + 1)));
  return changed(history.last, {
    moved: sum(past, "moved", moved, horizons_ms, ahead),
    turned: sum(past, "turned", turned, horizons_ms, ahead),
  });
};

function sum(
  past: readonly PoseChange[],
  kind: keyof PoseChange,
  axes: readonly Weights[],
  horizons: readonly number[],
  ahead: number,
): Vector3 {
  const along = (axis: 0 | 1 | 2) => {
    const weights = between(axes[axis] ?? [], horizons, ahead);
    return past.reduce((total, change, step) => total + change[kind][axis] * (weights[step] ?? 0), 0);
  };
  return [along(0), along(1), along(2)];
}

/** Interpolates between the trained horizons, from zero at the present; later ones use the last horizon. */
function between(weights: Weights, horizons: readonly number[], ahead: number): readonly number[] {
  const after = horizons.findIndex((horizon) => horizon >= ahead);
  if (after < 0) return weights.at(-1) ?? [];
  const start = horizons[after - 1] ?? 0;
  const share = (ahead - start) / ((horizons[after] ?? 1) - start);
  const before = weights[after - 1];
  return (weights[after] ?? []).map((weight, step) => {
    const from = before?.[step] ?? 0;
    return from + (weight - from) * share;
  });
}
