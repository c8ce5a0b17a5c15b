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
/**
 * Size of the first side in pixels; each next one is a pixel larger, so that no two have the same lens: the server
 * drops a view once a newer one through the same lens is being rendered (docs/protocol.md).
 */
const SIZE = 256;

/** A side as a view to ask for; `up`: of the scene. */
export function sideView(side: number, position: Vector3, up: Vector3): View {
  const [azimuth, elevation] = DIRECTIONS[side] ?? DIRECTIONS[0];
  const quaternion = multiply(levelFor(up), orientation(azimuth, elevation));
  const size = SIZE + side;
  const focal = size / 2 / Math.tan((HALF * Math.PI) / 180);
  return { position, quaternion, fx: focal, fy: focal, cx: size / 2, cy: size / 2, width: size, height: size };
}
