/** Extrapolates the camera's recent velocity, constant in its own frame. */
import type { ScenePose } from "../view/camera";
import { changed, PoseHistory } from "./pose-history";
import { NOWHERE, type Predictor } from "./predictor";

/** Milliseconds over which the velocity is measured: long enough to average out noise. */
const SPAN = 50;

export class Velocity implements Predictor {
  readonly #history = new PoseHistory(SPAN);

  observe(pose: ScenePose, at: number): void {
    this.#history.add(pose, at);
  }

  predict(ahead: number): ScenePose {
    const { last, known } = this.#history;
    if (last === undefined) return NOWHERE;
    const span = Math.min(SPAN, known);
    if (span === 0) return last;
    const { moved, turned } = this.#history.since(span);
    const times = -ahead / span;
    const [mx, my, mz] = moved;
    const [tx, ty, tz] = turned;
    return changed(last, {
      moved: [mx * times, my * times, mz * times],
      turned: [tx * times, ty * times, tz * times],
    });
  }

  reset(): void {
    this.#history.clear();
  }
}
