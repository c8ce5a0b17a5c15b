/**
 * Guards a predictor: it restarts after a cut, always answers with a valid pose, and returns exactly the
 * camera's pose when it rests, so that a still view settles.
 */
import type { ScenePose } from "../view/camera";
import { isCut } from "../view/cut";
import { samePose } from "../view/rig";
import { NOWHERE, type Predictor } from "./predictor";

/** A camera without movement for this many milliseconds rests. */
const RESTS_AFTER = 200;

export class Guarded implements Predictor {
  readonly #predictor: Predictor;
  readonly #distance: () => number;
  #pose: ScenePose | undefined;
  #at = 0;
  #changedAt = Number.NEGATIVE_INFINITY;

  /** `distance`: of the focus, in scene units. */
  constructor(predictor: Predictor, distance: () => number) {
    this.#predictor = predictor;
    this.#distance = distance;
  }

  observe(pose: ScenePose, at: number): void {
    if (!isSound(pose) || !Number.isFinite(at)) return;
    const before = this.#pose;
    const fresh = before === undefined || at < this.#at || isCut(before, pose, this.#distance());
    if (fresh) this.reset();
    else if (!samePose(before, pose)) this.#changedAt = at;
    this.#pose = pose;
    this.#at = at;
    this.#predictor.observe(pose, at);
  }

  predict(ahead: number): ScenePose {
    const pose = this.#pose;
    if (pose === undefined) return NOWHERE;
    if (!(ahead > 0) || this.#at - this.#changedAt > RESTS_AFTER) return pose;
    const predicted = this.#predictor.predict(ahead);
    if (samePose(predicted, pose)) return pose;
    const sound = { ...predicted, quaternion: normalised(predicted.quaternion) };
    return isSound(sound) ? sound : pose;
  }

  reset(): void {
    this.#pose = undefined;
    this.#changedAt = Number.NEGATIVE_INFINITY;
    this.#predictor.reset();
  }
}

function isSound({ position, quaternion }: ScenePose): boolean {
  return [...position, ...quaternion].every(Number.isFinite);
}

function normalised([x, y, z, w]: ScenePose["quaternion"]): ScenePose["quaternion"] {
  const length = Math.hypot(x, y, z, w);
  return [x / length, y / length, z / length, w / length];
}
