/** The depth of a picture from that of another with the same position and direction but a different lens or margins. */
import type { DepthMap } from "#client/transport/transport";
import type { Intrinsics, Viewport } from "../view/intrinsics";
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

type Lens = Intrinsics & Viewport;

/** The same number of codes, each the nearest one; outside of `from`, the depth of its edge is used. */
export function depthOfView({ width, height, nearest, codes }: DepthMap, from: Lens, to: Lens): DepthMap {
  const columns = Array.from({ length: width }, (_, i) => {
    const ray = (((i + 0.5) / width) * to.width - to.cx) / to.fx;
    return clamp(Math.floor(((ray * from.fx + from.cx) / from.width) * width), width);
  });
  const rows = Array.from({ length: height }, (_, i) => {
    const ray = (((i + 0.5) / height) * to.height - to.cy) / to.fy;
    return clamp(Math.floor(((ray * from.fy + from.cy) / from.height) * height), height);
  });
  const moved = rows.flatMap((row) => columns.map((column) => codes[row * width + column] ?? 0));
  return { width, height, nearest, codes: Uint8Array.from(moved) };
}

function clamp(index: number, count: number): number {
  return Math.min(count - 1, Math.max(0, index));
}
