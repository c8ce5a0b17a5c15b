/** The six sides of a surround: square views from one place, four of them level with the scene's floor, that overlap a little. */
import { levelFor, orientation } from "../view/camera";
import { multiply, type Vector3 } from "../view/vector";
import type { View } from "./view";

/** Azimuth and elevation of each, in degrees. */
const DIRECTIONS = [
  [0, 0],
  [90, 0],
  [180, 0],
  [-90, 0],
  [0, 90],
  [0, -90],
] as const;
export const SIDES: readonly number[] = [...DIRECTIONS.keys()];
/** Half of the field of view in degrees: more than 45, so that no gaps open between sides that were taken from different places. */
const HALF = 49;
const SIZE = 256;
const FOCAL = SIZE / 2 / Math.tan((HALF * Math.PI) / 180);

/** A side as a view to ask for; `up`: of the scene. */
export function sideView(side: number, position: Vector3, up: Vector3): View {
  const [azimuth, elevation] = DIRECTIONS[side] ?? DIRECTIONS[0];
  const quaternion = multiply(levelFor(up), orientation(azimuth, elevation));
  return { position, quaternion, fx: FOCAL, fy: FOCAL, cx: SIZE / 2, cy: SIZE / 2, width: SIZE, height: SIZE };
}
