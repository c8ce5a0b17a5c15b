/** The depth of a picture from that of another one of the same place and direction, with another lens or other margins. */

import type { DepthMap } from "#client/transport/picture";
import type { Intrinsics, Viewport } from "../view/intrinsics";

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
