/** Camera poses as text in links and attributes: `x,y,z,qx,qy,qz,qw` in the scene's own frame. Pure. */
import type { ScenePose } from "./camera";

/** Digits of a position and of a rotation, so that a link stays short. */
const PLACE_DIGITS = 6;
const ROTATION_DIGITS = 5;

export function poseText({ position, quaternion }: ScenePose): string {
  const rounded = (digits: number) => (value: number) => String(Number(value.toPrecision(digits)));
  return [...position.map(rounded(PLACE_DIGITS)), ...quaternion.map(rounded(ROTATION_DIGITS))].join();
}

/** The pose of a text; null if it is invalid. */
export function poseOf(at: string): ScenePose | null {
  const [x, y, z, qx, qy, qz, qw, ...more] = at.split(",").map((text) => (text.trim() ? Number(text) : Number.NaN));
  if (x === undefined || y === undefined || z === undefined || qw === undefined || more.length > 0) return null;
  if (qx === undefined || qy === undefined || qz === undefined) return null;
  const length = Math.hypot(qx, qy, qz, qw);
  if (!Number.isFinite(x + y + z) || !(length > 0.1 && length < 10)) return null;
  return { position: [x, y, z], quaternion: [qx / length, qy / length, qz / length, qw / length] };
}
