/** Expects the camera to go on as fast as it went lately, in the same direction of its own. */
import type { ScenePose } from "../view/camera";
import { changed, PoseHistory } from "./pose-history";
import { NOWHERE, type Predictor } from "./predictor";

/** The speed is measured over so many milliseconds: long enough to be more than noise. */
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
