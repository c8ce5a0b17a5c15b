/** Detects a cut: a camera that was placed elsewhere instead of moved, so that successive views are unrelated. */
import type { ScenePose } from "./camera";
import { angleBetween, subtract } from "./vector";

/** Degrees between two samples; no user turns as fast. */
const FARTHEST_TURN = 30;
/** Movement between two samples, as a share of the distance of the focus. */
const FARTHEST_MOVE = 0.3;

/** Whether the camera jumped between two samples; `distance` of the focus is in scene units. */
export function isCut(before: ScenePose, after: ScenePose, distance: number): boolean {
  return (
    angleBetween(before.quaternion, after.quaternion) > FARTHEST_TURN ||
    Math.hypot(...subtract(after.position, before.position)) > FARTHEST_MOVE * distance
  );
}
