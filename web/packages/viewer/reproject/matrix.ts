/** 3×3 matrices, row by row: projections of pixels and directions. */
import type { Quaternion, Vector3 } from "../view/vector";

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

/** Of a quaternion of length 1. */
export function rotationMatrix([x, y, z, w]: Quaternion): Matrix3 {
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
