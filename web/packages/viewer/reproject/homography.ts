/**
 * Position of a pixel of one view in another: turn · [u, v, 1] + ρ · shift, homogeneous, where ρ is the inverse depth
 * (1/z) of the pixel; 0 is infinitely far. The third component is positive in front of the other view's camera. Hartley
 * and Zisserman, Multiple View Geometry, equation 9.7: x' = K'RK⁻¹x + K't/Z.
 */
import { subtract, type Vector3 } from "../view/vector";
import { apply, type Matrix3, product, rotationMatrix, scaling, transposed } from "./matrix";
import type { View } from "./view";

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
