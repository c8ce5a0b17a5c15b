/** Expects the camera to stay where it is. */
import type { ScenePose } from "../view/camera";
import { NOWHERE, type Predictor } from "./predictor";

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
