/** Tells where a camera will be, from where it was. Pure: times come in, in milliseconds on one clock. */
import type { ScenePose } from "../view/camera";
import type { Rig } from "../view/rig";

export interface Predictor {
  /** Once per animation frame: where the camera is at a time. Times grow; nothing is far from what came before it. */
  observe(pose: ScenePose, at: number): void;
  /** Where it will be so long after what was observed last. Commits to nothing. */
  predict(ahead: number): ScenePose;
  /** Nothing that was observed says where the camera will go: it was put somewhere else. */
  reset(): void;
}

/** What a predictor is made of. */
export interface PredictorContext {
  readonly rig: Pick<Rig, "source" | "input" | "foresee">;
}

export type PredictorFactory = (context: PredictorContext) => Predictor;

/** Of a predictor that has observed nothing. */
export const NOWHERE: ScenePose = { position: [0, 0, 0], quaternion: [0, 0, 0, 1] };
