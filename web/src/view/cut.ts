/** A camera that was put elsewhere rather than moved: nothing of the view before belongs to the one after. */
import type { ScenePose } from "./camera";
import { angleBetween, subtract } from "./vector";

/** Between two samples, in degrees: nobody turns as fast. */
const FARTHEST_TURN = 30;
/** And as a share of the distance of what is looked at. */
const FARTHEST_MOVE = 0.3;

/** Whether the camera jumped between two samples; `distance` is that of what is looked at, in scene units. */
export function isCut(before: ScenePose, after: ScenePose, distance: number): boolean {
  return (
    angleBetween(before.quaternion, after.quaternion) > FARTHEST_TURN ||
    Math.hypot(...subtract(after.position, before.position)) > FARTHEST_MOVE * distance
  );
}
