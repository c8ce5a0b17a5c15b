/** A pinhole camera at a place: the view that a picture shows. Axes are OpenCV's: x right, y down, z forward. */
import type { Intrinsics, Viewport } from "../view/intrinsics";
import type { Quaternion, Vector3 } from "../view/vector";

/** The intrinsics are in pixels of a picture of this very size, margins included. */
export interface View extends Intrinsics, Viewport {
  /** Camera to world, in the scene's own frame. */
  readonly position: Vector3;
  readonly quaternion: Quaternion;
}

/** A frame's size in pixels, and its margin at each side beyond the requested view. */
export interface FrameSize extends Viewport {
  readonly marginX: number;
  readonly marginY: number;
}

/** The same field of view in a picture of another size. */
export function resized<Part extends Intrinsics & Viewport>(view: Part, width: number, height: number): Part {
  const across = width / view.width;
  const down = height / view.height;
  const lens = { fx: view.fx * across, fy: view.fy * down, cx: view.cx * across, cy: view.cy * down };
  return { ...view, ...lens, width, height };
}

/** The extent of a frame rendered for a view. */
export function viewOfFrame(asked: View, { width, height, marginX, marginY }: FrameSize): View {
  const inner = resized(asked, width - 2 * marginX, height - 2 * marginY);
  return { ...inner, cx: inner.cx + marginX, cy: inner.cy + marginY, width, height };
}
