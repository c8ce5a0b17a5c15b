/** Movement traces: camera poses with their own time stamps, in a levelled frame with OpenCV's axes. Pure. */

import { type ANCHORS, type UNITS, VIEW_M } from "#client/wire/movement";
import type { SceneInfo, StartCamera } from "#client/wire/render";
import { levelFor, orientation, type ScenePose, startCamera } from "../view/camera";
import { add, conjugate, multiply, rotate, subtract } from "../view/vector";
import type { TimedPose } from "./playback";

/** `start`: begins at the origin looking along z, which is the scene's start camera. `scene`: in the scene's levelled frame. */
export type Anchor = (typeof ANCHORS)[number];
/** The unit of positions: metres, or the scene's own. */
export type Unit = (typeof UNITS)[number];

export interface MovementTrace {
  readonly anchor: Anchor;
  readonly unit: Unit;
  /** Other metadata of the file, by key. */
  readonly comments: ReadonlyMap<string, string>;
  /** In a levelled frame; times grow from 0, rotations have the length one. Never empty. */
  readonly points: readonly TimedPose[];
  /** From the first pose to the last, in milliseconds. */
  readonly duration: number;
}

/** Why a text is no movement, in one sentence. */
export class MovementError extends Error {}

/** Less than `tigas` reads, because a page may be on a phone: more than 90 minutes at 90 poses a second. */
export const MAX_POINTS = 500_000;
/**
 * The movement in a scene's own frame and unit. Anchored at the start it begins where the start camera stands, turned by its
 * azimuth (not by its elevation: a movement looks level before it looks up or down); in a scene without one, at the origin.
 */
export function placeInScene(
  { anchor, unit, points }: Pick<MovementTrace, "anchor" | "unit" | "points">,
  scene: Pick<SceneInfo, "camera" | "up">,
): TimedPose[] {
  const level = levelFor(scene.up);
  const { position: origin, azimuth } = startCamera(anchor === "start" ? scene : { ...scene, camera: null });
  const rotation = multiply(level, orientation(azimuth, 0));
  const offset = rotate(level, origin);
  const scale = unit === "m" ? metre(scene.camera) : 1;
  return points.map(({ t_ms, position: [x, y, z], quaternion }) => ({
    t_ms,
    position: [...add(offset, rotate(rotation, [scale * x, scale * y, scale * z]))],
    quaternion: [...multiply(rotation, quaternion)],
  }));
}

/** A pose of the scene's own frame in its levelled frame, the frame of traces anchored to the scene. */
export function toLevelFrame({ position, quaternion }: ScenePose, scene: Pick<SceneInfo, "up">): ScenePose {
  const toLevel = conjugate(levelFor(scene.up));
  return { position: [...rotate(toLevel, position)], quaternion: [...multiply(toLevel, quaternion)] };
}

/** How many of the scene's units a metre is. */
function metre(camera: StartCamera | null): number {
  return camera === null ? 1 : Math.hypot(...subtract(camera.position, camera.look_at)) / VIEW_M || 1;
}
