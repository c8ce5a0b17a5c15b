/** Rotations as vectors along their axis, as long as their angle in radians: these can be added and scaled. */
import type { Quaternion, Vector3 } from "./vector";

/** Smaller angles count as no rotation, to avoid division by zero. */
const NOTHING = 1e-12;

/** The shorter rotation, for either sign of the quaternion. */
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
