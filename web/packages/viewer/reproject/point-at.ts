/** Position of the visible surface in a direction, from a picture's coarse depth. Pure. */

import type { DepthMap } from "#client/transport/picture";
import { add, conjugate, rotate, type Vector3 } from "../view/vector";
import type { View } from "./view";

/** In the scene's own frame, as `direction` is; null where the picture has no depth, ends, or is infinitely deep. */
export function pointAt(view: View, depth: DepthMap | null, direction: Vector3): Vector3 | null {
  const [x, y, z] = rotate(conjugate(view.quaternion), direction);
  if (depth === null || z <= 0) return null;
  const column = Math.floor((((x / z) * view.fx + view.cx) / view.width) * depth.width);
  const row = Math.floor((((y / z) * view.fy + view.cy) / view.height) * depth.height);
  if (column < 0 || column >= depth.width || row < 0 || row >= depth.height) return null;
  const code = depth.codes[row * depth.width + column] ?? 0;
  if (code === 0) return null;
  const far = 255 / (depth.nearest * code);
  return add(view.position, rotate(view.quaternion, [(x / z) * far, (y / z) * far, far]));
}
