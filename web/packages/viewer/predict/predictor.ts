/** Predicts the camera's pose from its past. Pure: time is an argument, in milliseconds on one clock. */
import type { ScenePose } from "../view/camera";

/** Expects the camera to stay where it is. */
export class Off implements Predictor {
  #pose = NOWHERE;

  observe(pose: ScenePose): void {
    this.#pose = pose;
  }

  predict(): ScenePose {
    return this.#pose;
  }

  reset(): void {
    this.#pose = NOWHERE;
  }
}

export interface Predictor {
  /** Records the camera's pose at a time, once per animation frame. Times increase; there are no cuts. */
  observe(pose: ScenePose, at: number): void;
  /** The pose at this time after the last observation. The call has no side effects. */
  predict(ahead: number): ScenePose;
  /** Discards the history after a cut. */
  reset(): void;
}

export const NOWHERE: ScenePose = { position: [0, 0, 0], quaternion: [0, 0, 0, 1] };
