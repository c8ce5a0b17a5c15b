/** Whether a view is a frame itself, but for the frame's margins. */
import { transfer, transferred } from "./homography";
import type { View } from "./view";

/** In pixels; smaller displacements are ignored. */
const TOLERANCE = 0.02;

export interface Crop {
  /** The frame's pixel at the view's top left. */
  readonly x: number;
  readonly y: number;
}

/** Which pixels of a frame are a view's, one for one; null if it must be warped. `nearest`: the largest inverse depth in the frame. */
export function cropFor(frame: View, view: View, nearest: number): Crop | null {
  const { width, height } = view;
  const toFrame = transfer(view, frame);
  const origin = transferred(toFrame, 0, 0, 0);
  if (origin === null) return null;
  const [x, y] = [Math.round(origin[0]), Math.round(origin[1])];
  if (x < 0 || y < 0 || x + width > frame.width || y + height > frame.height) return null;
  const corners = [0, width].flatMap((u) =>
    [0, height].flatMap((v) => [0, nearest].map((depth) => [u, v, depth] as const)),
  );
  const stays = ([u, v, inverseDepth]: (typeof corners)[number]) => {
    const pixel = transferred(toFrame, u, v, inverseDepth);
    return pixel !== null && Math.hypot(pixel[0] - u - x, pixel[1] - v - y) < TOLERANCE;
  };
  return corners.every(stays) ? { x, y } : null;
}
