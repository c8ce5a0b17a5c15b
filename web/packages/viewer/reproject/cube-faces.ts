/** The six sides of a cube map, in OpenGL's order, and which of them a view sees. */
import { add, subtract, type Vector3 } from "../view/vector";
import { directionOfPixel, pixelOfDirection } from "./homography";
import { apply, type Matrix3, product, scaling, transposed } from "./matrix";
import type { View } from "./view";

/** From [s, t, 1] on a side, -1 to 1 each, to a direction. OpenGL ES 3.0, table 3.19. */
export const FACES: readonly Matrix3[] = [
  [0, 0, 1, 0, -1, 0, -1, 0, 0],
  [0, 0, -1, 0, -1, 0, 1, 0, 0],
  [1, 0, 0, 0, 0, 1, 0, 1, 0],
  [1, 0, 0, 0, 0, -1, 0, -1, 0],
  [1, 0, 0, 0, -1, 0, 0, 0, 1],
  [-1, 0, 0, 0, -1, 0, 0, 0, -1],
];

/** The sides, by number, on which a view can leave a trace; at times one more. */
export function facesSeen(view: View): readonly number[] {
  const { width, height } = view;
  const toDirection = directionOfPixel(view);
  const toPixel = pixelOfDirection(view);
  const corners = [0, width].flatMap((u) => [0, height].map((v) => apply(toDirection, [u, v, 1])));
  const bounds = planes(rowsOf(product(scaling(2 / width, 2 / height, -1, -1), toPixel)));
  return [...FACES.keys()].filter((index) => {
    const face = FACES[index] as Matrix3;
    const edges = [-1, 1].flatMap((s) => [-1, 1].map((t) => apply(face, [s, t, 1])));
    const apart = (normal: Vector3, directions: readonly Vector3[]) => directions.every((one) => dot(normal, one) <= 0);
    return (
      !planes(rowsOf(transposed(face))).some((side) => apart(side, corners)) &&
      !bounds.some((side) => apart(side, edges))
    );
  });
}

/** The inward normals of the four planes that bound x / ahead and y / ahead to -1 to 1. */
function planes([x, y, ahead]: readonly [Vector3, Vector3, Vector3]): readonly Vector3[] {
  return [add(ahead, x), subtract(ahead, x), add(ahead, y), subtract(ahead, y)];
}

function rowsOf([a, b, c, d, e, f, g, h, i]: Matrix3): [Vector3, Vector3, Vector3] {
  return [
    [a, b, c],
    [d, e, f],
    [g, h, i],
  ];
}

function dot(a: Vector3, b: Vector3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
