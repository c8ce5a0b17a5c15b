/** A pinhole camera at a position: the view that a picture shows. Axes are OpenCV's: x right, y down, z forward. */
import type { Intrinsics, Viewport } from "../view/intrinsics";
import { type Quaternion, subtract, type Vector3 } from "../view/vector";

/** 3×3 matrices, row by row: projections of pixels and directions. */
export type Matrix3 = readonly [number, number, number, number, number, number, number, number, number];

export function product(a: Matrix3, b: Matrix3): Matrix3 {
  const [b0, b1, b2, b3, b4, b5, b6, b7, b8] = b;
  const row = (x: number, y: number, z: number) =>
    [x * b0 + y * b3 + z * b6, x * b1 + y * b4 + z * b7, x * b2 + y * b5 + z * b8] as const;
  return [...row(a[0], a[1], a[2]), ...row(a[3], a[4], a[5]), ...row(a[6], a[7], a[8])];
}

export function apply(m: Matrix3, [x, y, z]: Vector3): Vector3 {
  return [m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z];
}

export function transposed([a, b, c, d, e, f, g, h, i]: Matrix3): Matrix3 {
  return [a, d, g, b, e, h, c, f, i];
}

/** The rotation of a quaternion of length 1. */
function rotationMatrix([x, y, z, w]: Quaternion): Matrix3 {
  return [
    ...([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)] as const),
    ...([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)] as const),
    ...([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)] as const),
  ];
}

/** From x, y to scale · x + offset, for homogeneous points. */
export function scaling(scaleX: number, scaleY: number, offsetX = 0, offsetY = 0): Matrix3 {
  return [scaleX, 0, offsetX, 0, scaleY, offsetY, 0, 0, 1];
}

/*
 * Position of a pixel of one view in another: turn · [u, v, 1] + ρ · shift, homogeneous, where ρ is the inverse depth
 * (1/z) of the pixel; 0 is infinitely far. The third component is positive in front of the other view's camera. Hartley
 * and Zisserman, Multiple View Geometry, equation 9.7: x' = K'RK⁻¹x + K't/Z.
 */

export interface Transfer {
  readonly turn: Matrix3;
  readonly shift: Vector3;
}

export function transfer(from: View, to: View): Transfer {
  const toPixel = pixelOfDirection(to);
  return {
    turn: product(toPixel, directionOfPixel(from)),
    shift: apply(toPixel, subtract(from.position, to.position)),
  };
}

/** The pixel at which a view sees a point. */
export function transferred(
  { turn, shift }: Transfer,
  u: number,
  v: number,
  inverseDepth: number,
): [number, number] | null {
  const [x, y, z] = apply(turn, [u, v, 1]);
  const depth = z + inverseDepth * shift[2];
  return depth > 0 ? [(x + inverseDepth * shift[0]) / depth, (y + inverseDepth * shift[1]) / depth] : null;
}

/** From [u, v, 1] to a direction in the scene's frame with a component of 1 along the camera's axis. */
export function directionOfPixel({ fx, fy, cx, cy, quaternion }: View): Matrix3 {
  return product(rotationMatrix(quaternion), scaling(1 / fx, 1 / fy, -cx / fx, -cy / fy));
}

/** From a direction in the scene's frame to a homogeneous pixel. */
export function pixelOfDirection({ fx, fy, cx, cy, quaternion }: View): Matrix3 {
  return product(scaling(fx, fy, cx, cy), transposed(rotationMatrix(quaternion)));
}

/** Smaller displacements are ignored, in pixels. */
const TOLERANCE = 0.02;

export interface Crop {
  /** The frame's pixel at the view's top left. */
  readonly x: number;
  readonly y: number;
}

/** The frame's pixels that match a view one for one; null if it must be warped. `nearest` is the frame's largest inverse depth. */
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

/** A view; the intrinsics are in pixels of a picture of this size, margins included. */
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
