/** The camera's recent poses at any time: animation frames are irregular, and predictors look back in even steps. Pure. */
import { poseAt, type TimedPose } from "../movement/movement";
import type { ScenePose } from "../view/camera";
import {
  conjugate,
  fromRotationVector,
  multiply,
  rotate,
  subtract,
  toRotationVector,
  type Vector3,
} from "../view/vector";

/** How one pose differs from another, as seen from the other. */
export interface PoseChange {
  /** Displacement in scene units. */
  readonly moved: Vector3;
  /** Rotation vector: along the axis, in radians. */
  readonly turned: Vector3;
}

/** Predicts the pose at this many milliseconds after the last one. */
export type Predict = (history: PoseHistory, ahead: number) => ScenePose;

/** How far back poses are kept, in milliseconds: longer than any predictor looks back. */
const SPAN = 1000;
const NOWHERE: ScenePose = { position: [0, 0, 0], quaternion: [0, 0, 0, 1] };

export class PoseHistory {
  #poses: TimedPose[] = [];
  /** The last pose; the origin without any. */
  last = NOWHERE;

  /** Adds a pose; times are in milliseconds on one clock, and increase. */
  add(pose: ScenePose, at: number): void {
    if (this.#poses.at(-1)?.t_ms === at) this.#poses.pop();
    this.last = pose;
    this.#poses.push({ ...pose, t_ms: at });
    // The last sample before the span is kept to interpolate the pose at its start.
    const within = this.#poses.findIndex(({ t_ms }) => t_ms > at - SPAN);
    if (within > 1) this.#poses.splice(0, within - 1);
  }

  clear(): void {
    this.last = NOWHERE;
    this.#poses = [];
  }

  get empty(): boolean {
    return this.#poses.length === 0;
  }

  /**
   * Displacement of the pose this many milliseconds ago from the last one; the earliest known pose if that is too long
   * ago.
   */
  since(ago: number): PoseChange {
    const last = this.#poses.at(-1);
    if (last === undefined) return { moved: [0, 0, 0], turned: [0, 0, 0] };
    const { position, quaternion } = poseAt(this.#poses, last.t_ms - ago);
    const toLast = conjugate(last.quaternion);
    return {
      moved: rotate(toLast, subtract(position, last.position)),
      turned: toRotationVector(multiply(toLast, quaternion)),
    };
  }

  /** Length of the known history before the last pose, in milliseconds. */
  get known(): number {
    return (this.#poses.at(-1)?.t_ms ?? 0) - (this.#poses[0]?.t_ms ?? 0);
  }
}

/** A pose with a change applied; the same object if there is no change. */
export function changed(pose: ScenePose, { moved, turned }: PoseChange): ScenePose {
  if ([...moved, ...turned].every((value) => value === 0)) return pose;
  const [x, y, z] = rotate(pose.quaternion, moved);
  const [px, py, pz] = pose.position;
  return {
    position: [px + x, py + y, pz + z],
    quaternion: [...multiply(pose.quaternion, fromRotationVector(turned))],
  };
}
