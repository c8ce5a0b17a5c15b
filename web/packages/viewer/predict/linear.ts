/**
 * Linear autoregression: the future displacement is a weighted sum of past ones, in even steps back, for each axis of
 * the camera's own frame. `python -m benchmarks.train_predictor` trained the weights on headset recordings
 * (docs/adaptation.md).
 */
import type { ScenePose } from "../view/camera";
import type { Vector3 } from "../view/vector";
import coefficients from "./coefficients.json";
import { changed, type PoseChange, PoseHistory } from "./pose-history";
import { NOWHERE, type Predictor } from "./predictor";

const { step_ms: STEP, horizons_ms: HORIZONS, turned: TURNED, moved: MOVED } = coefficients;
const STEPS = TURNED[0]?.[0]?.length ?? 0;

/** Weights of each step, for each horizon: one axis. */
type Weights = readonly (readonly number[])[];

export class Linear implements Predictor {
  readonly #history = new PoseHistory(STEP * STEPS);

  observe(pose: ScenePose, at: number): void {
    this.#history.add(pose, at);
  }

  predict(ahead: number): ScenePose {
    const { last } = this.#history;
    if (last === undefined) return NOWHERE;
    const past = Array.from({ length: STEPS }, (_, i) => this.#history.since(STEP * (i + 1)));
    return changed(last, {
      moved: sum(past, "moved", MOVED, ahead),
      turned: sum(past, "turned", TURNED, ahead),
    });
  }

  reset(): void {
    this.#history.clear();
  }
}

function sum(past: readonly PoseChange[], kind: keyof PoseChange, axes: readonly Weights[], ahead: number): Vector3 {
  const along = (axis: 0 | 1 | 2) => {
    const weights = between(axes[axis] ?? [], ahead);
    return past.reduce((total, change, step) => total + change[kind][axis] * (weights[step] ?? 0), 0);
  };
  return [along(0), along(1), along(2)];
}

/** Interpolates between the trained horizons, from zero at the present; later ones use the last horizon. */
function between(weights: Weights, ahead: number): readonly number[] {
  const after = HORIZONS.findIndex((horizon) => horizon >= ahead);
  if (after < 0) return weights.at(-1) ?? [];
  const start = HORIZONS[after - 1] ?? 0;
  const share = (ahead - start) / ((HORIZONS[after] ?? 1) - start);
  const before = weights[after - 1];
  return (weights[after] ?? []).map((weight, step) => {
    const from = before?.[step] ?? 0;
    return from + (weight - from) * share;
  });
}
