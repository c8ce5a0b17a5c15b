/** Vectors and rotations, only as much as a camera needs. Quaternions are [x, y, z, w]. */

/** Smaller angles count as no rotation, to avoid division by zero. */
const NOTHING = 1e-12;

/** The rotation vector of the shorter rotation, for either sign of the quaternion. */
export function toRotationVector([x, y, z, w]: Quaternion): Vector3 {
  const sine = Math.hypot(x, y, z);
  if (sine < NOTHING) return [0, 0, 0];
  const scale = ((w < 0 ? -1 : 1) * 2 * Math.atan2(sine, Math.abs(w))) / sine;
  return [x * scale, y * scale, z * scale];
}

export function fromRotationVector([x, y, z]: Vector3): Quaternion {
  const angle = Math.hypot(x, y, z);
  if (angle < NOTHING) return [0, 0, 0, 1];
  const scale = Math.sin(angle / 2) / angle;
  return [x * scale, y * scale, z * scale, Math.cos(angle / 2)];
}

export type Vector3 = readonly [number, number, number];
export type Quaternion = readonly [number, number, number, number];

export function add(a: Vector3, b: Vector3): Vector3 {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

export function subtract(a: Vector3, b: Vector3): Vector3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

/** Hamilton product: the rotation `b`, then `a`. By index, because destructuring allocates iterators. */
export function multiply(a: Quaternion, b: Quaternion): Quaternion {
  return [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
    a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
    a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
  ];
}

export function conjugate(q: Quaternion): Quaternion {
  return [-q[0], -q[1], -q[2], q[3]];
}

export function rotate(q: Quaternion, v: Vector3): Vector3 {
  const rotated = multiply(multiply(q, [v[0], v[1], v[2], 0]), conjugate(q));
  return [rotated[0], rotated[1], rotated[2]];
}

/** The shortest rotation that turns the direction `from` into `to`; opposite directions turn about the x axis. */
export function rotationBetween(from: Vector3, to: Vector3): Quaternion {
  const scale = Math.hypot(...from) * Math.hypot(...to);
  if (scale === 0) return [0, 0, 0, 1];
  const dot = (from[0] * to[0] + from[1] * to[1] + from[2] * to[2]) / scale;
  if (dot < -1 + 1e-9) return [1, 0, 0, 0];
  const x = (from[1] * to[2] - from[2] * to[1]) / scale;
  const y = (from[2] * to[0] - from[0] * to[2]) / scale;
  const z = (from[0] * to[1] - from[1] * to[0]) / scale;
  const length = Math.hypot(x, y, z, 1 + dot);
  return [x / length, y / length, z / length, (1 + dot) / length];
}

/** Angle between two orientations, in degrees. */
export function angleBetween(a: Quaternion, b: Quaternion): number {
  const [x, y, z, w] = multiply(conjugate(a), b);
  return (2 * Math.atan2(Math.hypot(x, y, z), Math.abs(w)) * 180) / Math.PI;
}
